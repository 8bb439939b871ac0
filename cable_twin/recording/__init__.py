"""One snapshot in, one file or view out."""
