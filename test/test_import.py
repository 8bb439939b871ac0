"""Packages imported with each stage in a fresh interpreter, without any compilation."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib import import_module
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
    """Top-level packages after each import stage, number of compilations, and an own kernel cache."""
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
    """Few modules, so that a command answers before the solver is loaded."""
    loaded = imported[0]["package"]
    assert "cable_twin" in loaded
    assert not HEAVY & loaded


def public_names():
    """Public names with their paths, from the table of docs/scenarios.md."""
    (table,) = re.findall(
        r"^\| import from \| names \|\n.*\n((?:\|.*\n)+)", (ROOT / "docs/scenarios.md").read_text(), re.M
    )
    rows = [re.findall(r"`([\w.]+)`", row) for row in table.splitlines()]
    assert len({name for _, *names in rows for name in names}) == sum(len(names) for _, *names in rows)
    return {name: path for path, *names in rows for name in names}


def test_public_names_are_at_their_path():
    names = public_names()
    assert {name for name, path in names.items() if path == "cable_twin"} == set(cable_twin.__all__)
    for name, path in names.items():
        assert hasattr(import_module(path), name), f"{path}.{name}"
    with pytest.raises(AttributeError, match="module 'cable_twin' has no attribute 'nonsense'"):
        _ = cable_twin.nonsense


@pytest.mark.parametrize("folder", ["docs", "examples", "."])
def test_pages_and_examples_take_public_names_from_their_path(folder):
    names = public_names()
    for file in [*(ROOT / folder).glob("*.md"), *(ROOT / folder).glob("*.py")]:
        for path, imported in re.findall(r"^ *from (cable_twin[\w.]*) import ([\w, ]+)", file.read_text(), re.M):
            for name in re.findall(r"\w+", imported):
                assert names.get(name, path) == path, f"{file}: {name}"


def test_an_emergency_stop_waits_for_nothing_heavy():
    code = "import cable_twin.ros.client.drive, sys; print(*{name.partition('.')[0] for name in sys.modules})"
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert "cable_twin" in result.stdout.split()
    assert not HEAVY & set(result.stdout.split())


def test_a_twin_imports_nothing_that_its_start_does_not_need():
    """`scipy.stats` takes a second, `scipy.optimize` a third of one; what follows a plant or finds spans loads them."""
    pytest.importorskip("rclpy")
    code = "import cable_twin.ros.node, sys; print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not {"scipy.stats", "scipy.optimize", "matplotlib", "rerun"} & set(result.stdout.split())


def test_mechanics_imports_where_nothing_else_exists(imported):
    assert len(STAGES["mechanics"]) > 5
    assert not imported[0]["mechanics"] & set(OUTSIDE)


def test_simulation_imports_without_ros_and_logs(imported):
    assert not imported[0]["simulation"] & {"rclpy", "mcap", "rerun", "rosbags"}


def test_recording_and_offline_import_without_ros(imported):
    assert "rclpy" not in imported[0]["logs"]


def test_importing_the_simulation_compiles_nothing(imported):
    """Empty kernel cache after the import, as kernels are compiled when called."""
    _, compiled, cache = imported
    assert compiled == 0
    assert not list(cache.rglob("*.nb*"))
