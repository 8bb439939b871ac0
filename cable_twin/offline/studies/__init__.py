"""Parts of the command `study`: design of the cases, their runs on a cluster, what is kept of them, and indices."""
