"""Fingerprint of the sources of kernels, under which compiled code is kept."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path


class Sources:
    """Python sources of folders, as they were when this process first asked.

    Attributes:
        fingerprint: text that another content of any of them changes.
    """

    def __init__(self, *folders: Path) -> None:
        self._files = [file for folder in folders for file in sorted(folder.rglob("*.py"))]
        self._stamps = self._read_stamps()  # before the content: an edit meanwhile is seen as one
        self.fingerprint = hashlib.sha256(b"".join(file.read_bytes() for file in self._files)).hexdigest()[:12]

    def _read_stamps(self) -> list[tuple[int, int]]:
        return [(found.st_mtime_ns, found.st_size) for found in (file.stat() for file in self._files)]

    def are_unchanged(self) -> bool:
        """Return whether no file was edited since: code compiled after an edit is not that of the fingerprint."""
        try:
            return self._read_stamps() == self._stamps
        except OSError:  # one is gone
            return False


@functools.cache
def sources(*folders: Path) -> Sources:
    """Sources of folders, one object for a process."""
    return Sources(*folders)
