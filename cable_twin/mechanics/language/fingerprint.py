"""Fingerprint (hash) of the Python sources of kernels, under which their compiled code is cached."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path


class Sources:
    """Python source files of folders, with their fingerprint (hash) as first read by this process.

    Attributes:
        fingerprint: hash as text, which changes with the content of any of the files.
    """

    def __init__(self, *folders: Path) -> None:
        named = [(file.relative_to(folder), file) for folder in folders for file in sorted(folder.rglob("*.py"))]
        self._files = [file for _, file in named]
        self._stamps = self._read_stamps()  # before the content: an edit meanwhile is seen as one
        digests = (f"{name.as_posix()} {hashlib.sha256(file.read_bytes()).hexdigest()}" for name, file in named)
        self.fingerprint = hashlib.sha256("\n".join(digests).encode()).hexdigest()[:12]

    def _read_stamps(self) -> list[tuple[int, int]]:
        return [(found.st_mtime_ns, found.st_size) for found in (file.stat() for file in self._files)]

    def are_unchanged(self) -> bool:
        """Return whether all source files are as first read; the fingerprint covers no code compiled after an edit."""
        try:
            return self._read_stamps() == self._stamps
        except OSError:  # one is gone
            return False


@functools.cache
def sources(*folders: Path) -> Sources:
    """Python sources of folders with their fingerprint, read once by a process."""
    return Sources(*folders)
