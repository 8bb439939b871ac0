"""Shipped ropeways reduced to one strand of a rope driven by itself, without the returning strand."""

from __future__ import annotations

from pathlib import Path


def one_strand(name: str) -> Path:
    """Path of the chairlift or the gondola with its uphill strand alone."""
    return Path(__file__).resolve().parent / "one_strand" / f"{name}.yaml"
