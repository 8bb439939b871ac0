"""Command `drive`, and the client of a running twin's topics and services behind it."""
