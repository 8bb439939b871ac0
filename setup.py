"""ament_python package: installs alike with pip and with colcon."""

from glob import glob

from setuptools import find_packages, setup

setup(
    python_requires=">=3.10",  # in setup.cfg it becomes an object that colcon cannot read
    packages=find_packages(include=["cable_twin", "cable_twin.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/cable_twin"]),
        ("share/cable_twin", ["package.xml"]),
        ("share/cable_twin/config", glob("config/*.yaml")),
        ("share/cable_twin/launch", glob("launch/*.launch.py")),
        ("share/cable_twin/rviz", glob("rviz/*.rviz")),
        ("share/cable_twin/docs", ["docs/scenario.schema.json"]),  # where the first line of each scenario looks for it
    ],
)
