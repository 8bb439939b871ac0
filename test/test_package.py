"""Package as seen by ROS 2 and pip: existing keys, one version, addresses of the project."""

from __future__ import annotations

import re
from configparser import ConfigParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML

import cable_twin

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ElementTree.parse(ROOT / "package.xml").getroot()
KEYS = YAML(typ="safe").load((ROOT / "test" / "rosdep_keys.yaml").read_text(encoding="utf-8"))
SETUP = ConfigParser()
SETUP.read(ROOT / "setup.cfg")
DEPENDENCIES = [element.text for element in PACKAGE if element.tag.endswith("depend")]


def test_every_dependency_has_a_key_that_apt_can_serve():
    """Unknown keys of rosdep, and those it installs by pip, end `rosdep install` with nothing installed."""
    assert len(set(DEPENDENCIES)) == len(DEPENDENCIES)
    assert not set(DEPENDENCIES) - {*KEYS["released"], *KEYS["apt"]}
    assert not set(DEPENDENCIES) & {*KEYS["pip"], *KEYS["absent"]}
    assert not set(DEPENDENCIES) & set(KEYS["too_old"])


def test_what_apt_has_too_old_is_asked_for_by_setup():
    needed = SETUP["options"]["install_requires"].split()
    for *versions, wanted in KEYS["too_old"].values():
        name, low = wanted.split(">=")
        assert any(requirement.startswith(wanted) for requirement in needed), name
        for version in versions:
            assert [int(part) for part in version.split(".")] < [int(part) for part in low.split(".")]


@pytest.mark.parametrize("extra", ["ros"])
def test_message_packages_are_the_same_for_ros_and_for_pip(extra):
    wheels = {re.sub(r"\[.*", "", name) for name in SETUP["options.extras_require"][extra].split()}
    without = {"rcl_interfaces", "tf2_msgs", "ros2launch", "launch_ros"}  # a part of rclpy's wheel; none
    named = {name for name in DEPENDENCIES if name in KEYS["released"]} - without
    assert wheels == {f"ros-{name.replace('_', '-')}" for name in named}


def test_the_version_is_the_same_everywhere_and_has_its_changes():
    version = PACKAGE.findtext("version")
    assert re.fullmatch(r"\d+\.\d+\.\d+", version or "")
    assert SETUP["metadata"]["version"] == cable_twin.__version__ == version
    text = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    releases = re.findall(r"^(\d+\.\d+\.\d+) \((\d{4}-\d\d-\d\d)\)\n-+\n", text, re.MULTILINE)
    assert releases[0][0] == version
    assert [date for _, date in releases] == sorted((date for _, date in releases), reverse=True)
    for part in re.split(r"^\d+\.\d+\.\d+ .*\n-+\n", text, flags=re.MULTILINE)[1:]:
        assert re.search(r"^\* \S", part, re.MULTILINE), "a release without a change"


def test_addresses_are_those_of_the_project():
    (maintainer,) = PACKAGE.findall("maintainer")
    assert maintainer.text == SETUP["metadata"]["maintainer"] == "cable_twin maintainers"
    assert maintainer.get("email") == SETUP["metadata"]["maintainer_email"]
    urls = {url.get("type"): url.text for url in PACKAGE.findall("url")}
    assert set(urls) == {"website", "repository", "bugtracker"}
    assert SETUP["metadata"]["url"] == urls["website"]
    assert {line.split(" = ")[1] for line in SETUP["metadata"]["project_urls"].strip().split("\n")} == {
        urls["repository"],
        urls["bugtracker"],
    }


def test_catkin_reads_the_package_without_a_warning():
    """Parser of colcon and rosdep, with its checks of form and content."""
    package = pytest.importorskip("catkin_pkg.package")
    warnings: list[str] = []
    read = package.parse_package_string((ROOT / "package.xml").read_text(encoding="utf-8"), warnings=warnings)
    read.validate(warnings=warnings)
    assert not warnings
    assert read.get_build_type() == "ament_python"
