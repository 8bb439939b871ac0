"""Basics of the whole package: printable texts, units, YAML within limits, files on disk."""
