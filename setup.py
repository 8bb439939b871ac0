"""ament_python package: installs alike with pip and with colcon."""

import sys
from configparser import ConfigParser
from glob import glob
from pathlib import Path

from setuptools import Distribution, find_packages, setup

DECLARED = ConfigParser()
DECLARED.read(Path(__file__).with_name("setup.cfg"), encoding="utf-8")
SCRIPTS = DECLARED["options.entry_points"]["console_scripts"].strip().splitlines()
COMMANDS = [script.partition("=")[0].strip() for script in SCRIPTS]
SHARED = "examples/control_experiment.py"  # what the controllers have in common
CONTROLLERS = tuple(f"examples/{name}.py" for name in ("swing_damping", "tower_pass", "trapezoid_driver", "wind_speed"))
RELAY = """\
#!/bin/sh
exec "$(dirname "$0")/../../bin/$(basename "$0")" "$@"
"""


def behind_ros2_run() -> list[tuple[str, list[str]]]:
    """What `ros2 run` finds of a pip install, whose commands are in bin/; colcon puts those themselves there."""
    if "bdist_wheel" not in sys.argv:
        return []
    directory = Path("build") / "ros2_run"
    directory.mkdir(parents=True, exist_ok=True)
    relays = [directory / name for name in (*COMMANDS, *(Path(script).name for script in CONTROLLERS))]
    for relay in relays:
        relay.write_text(RELAY)
        relay.chmod(0o755)
    return [("lib/cable_twin", [str(relay) for relay in relays])]


class WithKernels(Distribution):
    """A wheel with compiled kernels is for one Python on one kind of machine."""

    def has_ext_modules(self) -> bool:
        """Whether there are any: `python -m cable_twin.kernels build` makes them."""
        return bool(glob("cable_twin/compiled/*"))


setup(
    distclass=WithKernels,
    python_requires=">=3.10",  # in setup.cfg it becomes an object that colcon cannot read
    packages=find_packages(include=["cable_twin", "cable_twin.*"]),
    scripts=[SHARED, *CONTROLLERS],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/cable_twin"]),
        ("share/cable_twin", ["package.xml"]),
        ("share/cable_twin/config", glob("config/*.yaml")),
        ("share/cable_twin/launch", glob("launch/*.launch.py")),
        ("share/cable_twin/ros2_control", glob("examples/ros2_control/*.*")),
        ("share/cable_twin/rviz", glob("rviz/*.rviz")),
        ("share/cable_twin/survey", glob("examples/survey/*.*")),
        ("share/cable_twin/security", glob("security/*.xml")),
        ("share/cable_twin/doors", ["examples/plant_map.yaml", "examples/opcua_plant.py"]),
        # where the first line of each scenario, and of a map, looks for it
        ("share/cable_twin/docs", ["docs/scenario.schema.json", "docs/plant_map.schema.json"]),
        *behind_ros2_run(),
    ],
)
