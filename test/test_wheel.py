"""A wheel with compiled kernels: starts from it, in an environment of its own, compile nothing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from twin_process import TwinProcess, environment

from cable_twin.kernels import main
from verification import JIT

ROOT = Path(__file__).resolve().parents[1]
GENERATED = (".*", "__pycache__", "*.egg-info", "build", "install", "log", "cable_twin_logs", "pictures", "compiled")
SCENARIO = "aerial_tramway"
FIRST_FRAME = 4.0  # s of processor time, as other programs may be at work; `.ci/wheel` asks for 4 s of a clock


def test_a_scenario_that_is_none_is_told_in_a_line_and_nothing_is_removed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("cable_twin.kernels.SHIPPED", tmp_path)
    (tmp_path / "kept").touch()
    assert main(["build", "no_such_ropeway"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("python -m cable_twin.kernels: scenario: given 'no_such_ropeway'")
    assert (tmp_path / "kept").exists()


def run(*command, **options):
    """Run a command to its end; with what it printed."""
    result = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False, **options)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout + result.stderr


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Directory of the commands of a wheel with the kernels of a scenario, and their variables.

    Other packages are those of this environment.
    """
    directory = tmp_path_factory.mktemp("wheel")
    checkout = directory / "cable_twin"
    shutil.copytree(ROOT, checkout, ignore=shutil.ignore_patterns(*GENERATED))
    variables = environment(directory)
    del variables["PYTHONPATH"]
    variables["NUMBA_CACHE_DIR"] = str(directory / "kernels")
    said = run(sys.executable, "-m", "cable_twin.kernels", "build", SCENARIO, cwd=checkout, env=variables)
    assert f"{checkout}/cable_twin/compiled: " in said
    wheel = ("wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(directory))
    run(sys.executable, "-m", "pip", *wheel, str(checkout), env=variables)
    (file,) = directory.glob("*.whl")
    assert "-none-any" not in file.name, "it is for one Python on one kind of machine"
    shutil.rmtree(checkout)
    run(sys.executable, "-m", "venv", directory / "fresh")
    python = directory / "fresh" / "bin" / "python"
    (packages,) = (directory / "fresh").glob("lib/python*/site-packages")
    others = [place for place in sys.path if place.endswith("-packages")]
    (packages / "others.pth").write_text("\n".join(others))
    run(python, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--ignore-installed", file, env=variables)
    return python.parent, variables


def kept(variables):
    """Compiled code in the user's cache."""
    return [*Path(variables["NUMBA_CACHE_DIR"]).rglob("*.nb*")]


@pytest.mark.long
@pytest.mark.skipif(not JIT, reason="nothing is compiled")
def test_simulate_compiles_nothing_and_scenarios_of_other_types_still_run(installed, tmp_path):
    commands, variables = installed
    said = run(commands / "simulate", SCENARIO, "--duration", "1", "--record", "off", cwd=tmp_path, env=variables)
    assert "compil" not in said
    assert not kept(variables)
    other = variables | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    said = run(commands / "simulate", "windy_tramway", "--duration", "0.1", "--record", "off", cwd=tmp_path, env=other)
    assert "kernels compiled in " in said
    assert kept(other)


@pytest.mark.long
@pytest.mark.skipif(not JIT, reason="nothing is compiled")
def test_sim_compiles_nothing_and_its_first_frame_is_there_within_4_seconds(installed, tmp_path):
    pytest.importorskip("rclpy")
    commands, variables = installed
    twin = TwinProcess(tmp_path, SCENARIO, command=[os.fspath(commands / "sim")], variables=variables)
    try:
        twin.wait_for(" runs at ")
        fields = Path(f"/proc/{twin.process.pid}/stat").read_text().rpartition(")")[2].split()
        taken = sum(int(ticks) for ticks in fields[11:13]) / os.sysconf("SC_CLK_TCK")
        assert twin.end() == 0
    finally:
        twin.kill()
    assert "compil" not in twin.output
    assert not kept(variables)
    assert taken < FIRST_FRAME
