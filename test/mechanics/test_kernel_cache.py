"""Kernel cache: damaged files are compiled anew, and a cache writable by others is not used."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cable_twin.mechanics.language.kernel_cache import refuse_shared
from verification import JIT

ROOT = Path(__file__).parents[2]
MODULE = """
from cable_twin.mechanics.language.compilation import kernel


@kernel
def inner(x):
    return x + 1.0


@kernel
def twice(x):
    return 2.0 * inner(x)
"""

pytestmark = pytest.mark.skipif(not JIT, reason="nothing is kept without compilation")


def run(directory):
    """Output and errors of a process that calls a kernel."""
    folder = directory / "kernels_of_a_test"
    folder.mkdir(exist_ok=True)
    (folder / "small.py").write_text(MODULE)
    paths = os.pathsep.join([str(folder), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-c", "import small; print(small.twice(2.0))"],
        env={**os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(directory / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "6.0\n"), done.stderr
    return done.stderr


def test_a_damaged_cache_is_compiled_anew(tmp_path):
    assert run(tmp_path) == ""
    kept = {file: file.read_bytes() for file in (tmp_path / "cache").rglob("*.nb*")}
    assert {file.suffix for file in kept} == {".nbi", ".nbc"}
    for suffix, damage in ((".nbi", lambda data: data[: len(data) // 2]), (".nbc", lambda data: b"garbage" + data)):
        for file, data in kept.items():
            if file.suffix == suffix:
                file.write_bytes(damage(data))
        said = run(tmp_path)
        assert "damaged (" in said
        assert "its kernel is compiled anew" in said
        assert "Traceback" not in said
        assert run(tmp_path) == "", "what was compiled is kept"


def test_a_cache_that_others_may_write_is_not_used(tmp_path):
    shared = tmp_path / "cache" / "cable_twin"
    shared.mkdir(parents=True)
    shared.chmod(0o777)
    said = run(tmp_path)
    assert "others may write there (mode 777): compiled kernels cannot be kept" in said
    assert not list(shared.iterdir())
    shared.chmod(0o775)
    assert run(tmp_path) == ""
    assert shared.stat().st_mode & 0o022 == 0, "closed to the group"
    assert list(shared.iterdir())


def test_a_cache_of_somebody_else_is_not_used(tmp_path, monkeypatch):
    if os.geteuid() == 0:
        os.chown(tmp_path, 12345, 12345)
    else:  # who cannot give a directory away is somebody else for the check
        monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
    with pytest.raises(PermissionError, match="it belongs to another user"):
        refuse_shared(tmp_path)
