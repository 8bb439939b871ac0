"""The shipped ropeways as they were with one strand of a rope that is driven by itself, and comes back unseen."""

from __future__ import annotations

from pathlib import Path


def one_strand(name: str) -> Path:
    """File of the chairlift or the gondola with its uphill strand alone."""
    return Path(__file__).resolve().parent / "one_strand" / f"{name}.yaml"
