"""Kernel cache: damaged files are compiled anew, and a cache writable by others is not used."""

from __future__ import annotations

import os
import shutil
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


SHIPPED = """
import sys
from pathlib import Path
from numba.core import event
from cable_twin.mechanics.language import kernel_cache

kernel_cache.SHIPPED = Path(sys.argv[1])
import small

with event.install_recorder("numba:compile") as recorder:
    print(small.twice(2.0), len(recorder.buffer) // 2)
"""


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
    assert "given mode 777, with which others may write" in said
    assert "compiled kernels cannot be kept" in said
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
    with pytest.raises(PermissionError, match="given owner "):
        refuse_shared(tmp_path)


def run_shipped(folder, shipped, own, **variables):
    """Result and number of kernels compiled by a process for which those of a directory came with the package."""
    paths = os.pathsep.join([str(folder), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-c", SHIPPED, str(shipped)],
        env={
            **os.environ,
            "PYTHONPATH": paths,
            "NUMBA_CACHE_DIR": str(own),
            "PYTHONDONTWRITEBYTECODE": "1",
            **variables,
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split(), done.stderr


def write_source(folder, text):
    """Write the source of a kernel with the time of all others."""
    (folder / "small.py").write_text(text)
    os.utime(folder / "small.py", (1e9, 1e9))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder with a source and, in `cable_twin`, its compiled kernels."""
    folder = tmp_path_factory.mktemp("made")
    write_source(folder, MODULE)
    assert run_shipped(folder, folder / "none", folder)[0] == ["6.0", "2"]
    return folder


def test_kernels_that_came_with_the_package_are_taken_wherever_it_is(made, tmp_path):
    """Elsewhere, and written at another time, as a wheel is unpacked; the user's cache is not asked then."""
    installed, shipped = tmp_path / "installed", tmp_path / "shipped"
    installed.mkdir()
    shutil.copy(made / "small.py", installed)
    shutil.copytree(made / "cable_twin", shipped)
    for file in shipped.rglob("from_kernels"):
        shutil.rmtree(file)
    for file in [*installed.iterdir(), *shipped.rglob("*")]:
        os.utime(file, (1.1e9, 1.1e9))
    shared = tmp_path / "own"
    shared.write_text("no directory")  # as of a user without a home: nobody is told, as nothing is needed there
    assert run_shipped(installed, shipped, shared) == (["6.0", "0"], "")
    assert run_shipped(installed, shipped, shared, NUMBA_CPU_NAME="skylake") == (["6.0", "0"], "")


@pytest.mark.parametrize(
    ("before", "after", "result"), [("2.0 *", "3.0 *", "9.0"), ("x + 1.0", "x + 2.0", "8.0"), ("2.0 *", "1.0 *", "3.0")]
)
def test_kernels_of_other_sources_are_never_taken(made, tmp_path, before, after, result):
    """A text as long, of the same time: neither that of the kernel itself nor that of one that it calls."""
    write_source(made, MODULE.replace(before, after))
    try:
        printed, _ = run_shipped(made, made / "cable_twin", tmp_path)
    finally:
        write_source(made, MODULE)
    assert printed == [result, "2"]


def test_a_damaged_file_that_came_with_the_package_is_compiled_anew_and_left_as_it_is(made, tmp_path):
    shipped = tmp_path / "shipped"
    shutil.copytree(made / "cable_twin", shipped)
    for file in shipped.rglob("*.nbc"):
        file.write_bytes(b"garbage")
    kept = {file: file.read_bytes() for file in shipped.rglob("*.nb?")}
    printed, said = run_shipped(made, shipped, tmp_path / "own")
    assert printed == ["6.0", "2"]
    assert "its kernel is compiled anew" in said
    assert kept == {file: file.read_bytes() for file in shipped.rglob("*.nb?")}
