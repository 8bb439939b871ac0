"""Package in a ROS 2 workspace: built by colcon, started from the directories of `ros2 run`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from twin_process import TwinProcess, environment

pytest.importorskip("rclpy")
from ros_participant import Participant

ROOT = Path(__file__).resolve().parents[2]
GENERATED = (".*", "__pycache__", "*.egg-info", "build", "install", "log", "cable_twin_logs", "pictures", "compiled")


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    """Built workspace with a copy of the checkout."""
    directory = tmp_path_factory.mktemp("workspace")
    shutil.copytree(ROOT, directory / "src" / "cable_twin", ignore=shutil.ignore_patterns(*GENERATED))
    variables = environment(directory)
    del variables["PYTHONPATH"]  # the checkout must not stand in for what is installed
    # colcon takes the interpreter that runs it; its scripts lie beside
    variables["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), variables["PATH"]])
    variables["COLCON_HOME"] = str(directory / "colcon_home")
    result = subprocess.run(
        [sys.executable, "-m", "colcon", "build"],
        cwd=directory,
        env=variables,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return directory, variables


def test_executables_are_where_ros2_run_looks(workspace):
    directory, _ = workspace
    prefix = directory / "install" / "cable_twin"
    executables = {path.name for path in (prefix / "lib" / "cable_twin").iterdir()}
    assert {"sim", "drive", "replay", "swing_damping.py"} <= executables
    assert all(os.access(path, os.X_OK) for path in (prefix / "lib" / "cable_twin").iterdir())
    assert (prefix / "share" / "ament_index" / "resource_index" / "packages" / "cable_twin").is_file()
    assert (prefix / "share" / "cable_twin" / "package.xml").is_file()
    shipped = {path.name for path in (prefix / "share" / "cable_twin" / "config").glob("*.yaml")}
    assert shipped == {path.name for path in (ROOT / "config").glob("*.yaml")}
    for folder in ("launch", "rviz"):
        installed = {path.name for path in (prefix / "share" / "cable_twin" / folder).iterdir()}
        assert installed == {path.name for path in (ROOT / folder).glob("*.*")}
    assert (prefix / "share" / "cable_twin" / "docs" / "scenario.schema.json").is_file()  # each of them names it


LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
path, *arguments = sys.argv[1:]
source = PythonLaunchDescriptionSource(path)
service = LaunchService(noninteractive=True)
given = [argument.split(":=") for argument in arguments]
service.include_launch_description(LaunchDescription([IncludeLaunchDescription(source, launch_arguments=given)]))
sys.exit(service.run())
"""


@pytest.mark.parametrize(
    ("file", "arguments", "nodes"),
    [
        ("sim", ["scenario:=seed_example", "namespace:=south"], ["/south/cable_twin"]),
        ("two_lifts", ["valley:=seed_example", "summit:=seed_example"], ["/valley/cable_twin", "/summit/cable_twin"]),
        ("follow", ["scenario:=single_span", "plant_set:=wind.x=3"], ["/cable_twin", "/plant"]),
    ],
)
def test_launch_files_start_twins_and_end_them(workspace, domain, tmp_path, file, arguments, nodes):
    """Run with the real launch package where installed, as it has no wheel."""
    pytest.importorskip("launch_ros.actions")
    directory, variables = workspace
    share = directory / "install" / "cable_twin" / "share" / "cable_twin"
    script = f'. {directory}/install/setup.sh && exec {sys.executable} -c "$LAUNCH" "$@"'
    brought = [path for path in sys.path if path and not (Path(path) / "cable_twin").exists()]
    extra = {
        **variables,
        "ROS_DOMAIN_ID": str(domain),
        "LAUNCH": LAUNCH,
        "PYTHONPATH": os.pathsep.join(brought),
    }
    command = ["sh", "-c", script, "launch", str(share / "launch" / f"{file}.launch.py"), *arguments]
    process = TwinProcess(tmp_path, domain=domain, command=command, variables=extra)
    try:
        for node in nodes:
            process.wait_for(f"commands on {node}/joint_commands")
        assert process.end() == 0, process.output
        assert process.output.count("log closed") == len(nodes)
        assert len(list(tmp_path.glob("cable_twin_logs/**/*.mcap"))) == len(nodes)
    finally:
        process.kill()


@pytest.mark.long
def test_a_pip_install_is_found_by_ros2_run_too(tmp_path):
    """Files in the directories in which ament finds packages and `ros2 run` executables."""
    pytest.importorskip("wheel")
    source, prefix = tmp_path / "source", tmp_path / "prefix"
    shutil.copytree(ROOT, source, ignore=shutil.ignore_patterns(*GENERATED))
    # what is installed in this environment would be uninstalled for it
    install = ["install", "--quiet", "--no-deps", "--no-build-isolation", "--ignore-installed"]
    install += ["--prefix", str(prefix), str(source)]
    subprocess.run([sys.executable, "-m", "pip", *install], check=True, timeout=300)
    found = subprocess.run(
        [sys.executable, "-c", "import ament_index_python as a; print(a.get_package_prefix('cable_twin'))"],
        env={**environment(tmp_path), "AMENT_PREFIX_PATH": str(prefix)},
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    assert Path(found.stdout.strip()) == prefix
    (site,) = prefix.glob("lib/python*/site-packages")
    executables = prefix / "lib" / "cable_twin"
    scripts = {path.name for path in (prefix / "bin").iterdir() if path.is_file()} - {"control_experiment.py"}
    assert {path.name for path in executables.iterdir()} == scripts
    for name in ("sim", "swing_damping.py"):
        result = subprocess.run(
            [executables / name, "--help"],
            env={**environment(tmp_path), "PYTHONPATH": str(site)},
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert result.returncode == 0, result.stderr
        assert result.stdout.startswith(f"usage: {name} ")


def test_node_runs_from_the_workspace(workspace, domain, tmp_path):
    directory, variables = workspace
    script = (
        f". {directory}/install/setup.sh && exec $COLCON_PREFIX_PATH/cable_twin/lib/cable_twin/sim "
        "--scenario seed_example --frame-rate 10 --rerun none"
    )
    extra = {**variables, "ROS_DOMAIN_ID": str(domain)}
    process = TwinProcess(tmp_path, domain=domain, command=["sh", "-c", script], variables=extra)
    try:
        participant = Participant(domain)
        try:
            participant.subscribe_standard()
            participant.until(lambda: len(participant.received["joint_states"]) >= 2)
            state = participant.received["joint_states"][-1]
        finally:
            participant.close()
        assert state.name == ["carriage", "carriage_rb1", "carriage_rb2"]
        assert process.end() == 0
        assert "'seed_example' runs at 10 Hz" in process.output
        assert len(list(process.run_directory.glob("*.mcap"))) == 1
    finally:
        process.kill()


def test_scenarios_are_found_in_the_installed_package(workspace, tmp_path):
    directory, variables = workspace
    code = "import cable_twin, cable_twin.scenario as s; print(cable_twin.__file__, s.config_directory())"
    result = subprocess.run(
        ["sh", "-c", f'. {directory}/install/setup.sh && exec {sys.executable} -c "{code}"'],
        cwd=tmp_path,
        env=variables,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    module, config = result.stdout.split()
    prefix = directory / "install" / "cable_twin"
    assert Path(module).is_relative_to(prefix)
    assert Path(config) == prefix / "share" / "cable_twin" / "config"
