"""Versions of the format of a log: which one is written, which ones are read."""

from __future__ import annotations

FORMAT_VERSION = "3"
ABSOLUTE_FORMATS = ("1", "2")  # with the pitch of each body instead of its joint, and all forces in one frame
READABLE_FORMATS = (*ABSOLUTE_FORMATS, FORMAT_VERSION)
