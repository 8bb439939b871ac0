"""How every kernel of the mechanics is compiled: once, without the interpreter lock, and kept on disk.

No `fastmath`: with the arithmetic of IEEE 754 as written, results do not depend on what the compiler inlines where,
so that a fresh compilation, a cached one and another process agree to the last bit. It costs a tenth of the speed.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba


def cache_directory() -> Path:
    """Where compiled kernels are kept: one directory for each version of the sources of this package.

    numba itself asks only whether the file of a kernel has changed, not those of the kernels that it calls.
    """
    fingerprint = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        fingerprint.update(source.read_bytes())
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "cable_twin" / f"kernels-{fingerprint.hexdigest()[:12]}"


_CACHE_DIRECTORY = str(cache_directory())


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile `function` on its first call, or load it from the cache."""
    config: Any = numba.config
    before = config.CACHE_DIR
    config.CACHE_DIR = _CACHE_DIRECTORY  # read by numba while it decorates, and only then
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    finally:
        config.CACHE_DIR = before
