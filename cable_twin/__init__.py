"""Live digital twin of a ropeway."""

__version__ = "0.2.0"
