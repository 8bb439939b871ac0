"""What `import cable_twin` brings with it: next to nothing, so that a command answers before the solver is loaded."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cable_twin

ROOT = Path(cable_twin.__file__).resolve().parents[1]
HEAVY = {"numba", "llvmlite", "numpy", "scipy", "rerun", "rclpy", "pydantic", "matplotlib"}


def run(code: str, **variables: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={"PATH": "/usr/bin:/bin", "HOME": str(ROOT), **variables},
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    ).stdout


def test_the_package_loads_nothing_heavy():
    loaded = run("import sys; import cable_twin; print(*{name.partition('.')[0] for name in sys.modules})").split()
    assert "cable_twin" in loaded
    assert not HEAVY & set(loaded)


def test_importing_the_simulation_compiles_nothing(tmp_path):
    """With a cache of its own, which stays empty: kernels are compiled when they are called, not when imported."""
    code = """
from numba.core import event
with event.install_recorder("numba:compile") as recorder:
    import cable_twin.simulation, cable_twin.scenario
print(len(recorder.buffer))
"""
    assert run(code, NUMBA_CACHE_DIR=str(tmp_path)).strip() == "0"
    assert not list(tmp_path.rglob("*.nb*"))
