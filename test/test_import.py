"""What imports bring with them, one after the other in a fresh interpreter; and that they compile nothing."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from test_architecture import OUTSIDE, is_within, modules

import cable_twin

ROOT = Path(cable_twin.__file__).resolve().parents[1]
HEAVY = {"numba", "llvmlite", "numpy", "scipy", "rerun", "rclpy", "pydantic", "matplotlib"}
STAGES = {
    "package": ["cable_twin"],
    "mechanics": [f"cable_twin.{name}" for name in modules() if is_within(name, "mechanics")],
    "simulation": ["cable_twin.simulation", "cable_twin.scenario"],
    "logs": [f"cable_twin.{name}" for name in modules() if name.split(".")[0] in ("recording", "offline")],
}
CODE = """
import json, sys
from importlib import import_module

def load(stage):
    for name in stages[stage]:
        import_module(name)
    loaded[stage] = sorted({name.partition(".")[0] for name in sys.modules})

stages, loaded = json.loads(sys.argv[1]), {}
load("package")
from numba.core import event
with event.install_recorder("numba:compile") as recorder:
    load("mechanics")
    load("simulation")
load("logs")
print(json.dumps([loaded, len(recorder.buffer)]))
"""


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """Top-level packages that are there after each stage, how much was compiled, and a cache for it alone."""
    cache = tmp_path_factory.mktemp("cache")
    result = subprocess.run(
        [sys.executable, "-c", CODE, json.dumps(STAGES)],
        cwd=ROOT,
        env={"PATH": "/usr/bin:/bin", "HOME": str(ROOT), "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    loaded, compiled = json.loads(result.stdout)
    return {stage: set(names) for stage, names in loaded.items()}, compiled, cache


def test_the_package_loads_nothing_heavy(imported):
    """Next to nothing, so that a command answers before the solver is loaded."""
    loaded = imported[0]["package"]
    assert "cable_twin" in loaded
    assert not HEAVY & loaded


def test_an_emergency_stop_waits_for_nothing_heavy():
    code = "import cable_twin.ros.client.drive, sys; print(*{name.partition('.')[0] for name in sys.modules})"
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert "cable_twin" in result.stdout.split()
    assert not HEAVY & set(result.stdout.split())


def test_mechanics_imports_where_nothing_else_exists(imported):
    assert len(STAGES["mechanics"]) > 5
    assert not imported[0]["mechanics"] & set(OUTSIDE)


def test_simulation_imports_without_ros_and_logs(imported):
    assert not imported[0]["simulation"] & {"rclpy", "mcap", "rerun", "rosbags"}


def test_recording_and_offline_import_without_ros(imported):
    assert "rclpy" not in imported[0]["logs"]


def test_importing_the_simulation_compiles_nothing(imported):
    """With a cache of its own, which stays empty: kernels are compiled when they are called, not when imported."""
    _, compiled, cache = imported
    assert compiled == 0
    assert not list(cache.rglob("*.nb*"))
