"""The node's parameters: one table for ROS parameters, for the options of `sim` and for their help."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from cable_twin.rates import EVERY_FRAME, LOGGED, PUBLISHED
from cable_twin.recording.splitting import Splitting

RERUN_MODES = ("none", "file", "live", "web")
FALSE = ("off", "false")  # what stands for none; YAML reads the former as the latter
CHANGING = ("scenario", "command_timeout", "step_count")  # may be set while the twin runs


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter: what it means, its unit and what it may be."""

    name: str
    default: str | bool | int | float
    description: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    pattern: str = ""  # that a text has to match

    @property
    def placeholder(self) -> str:
        """What stands for the value in a usage line: its unit, or its kind."""
        return (
            self.unit.upper() or {bool: "{true,false}", str: "TEXT", int: "COUNT", float: "NUMBER"}[type(self.default)]
        )

    @property
    def help(self) -> str:
        """Description with unit and range."""
        text = self.description
        if self.low is not None:
            text += f" ({self.low:g} to {self.high:g}{' ' + self.unit if self.unit else ''})"
        elif self.choices:
            text += f" ({', '.join(self.choices)})"
        return text

    def meant(self, value: Any) -> Any:
        """A value as it is meant: a whole number where any is allowed, and none in other words."""
        if isinstance(self.default, float) and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
        if "none" in self.choices and (value is False or value in FALSE):
            return "none"
        return value

    def fault(self, value: object) -> str | None:
        """What is wrong with a value, in a line; None when nothing is."""
        if self.pattern and not re.fullmatch(self.pattern, str(value)):
            return f"parameter '{self.name}' is '{value}'; {self.description}"
        if self.choices and value not in self.choices:
            return f"parameter '{self.name}' is '{value}'; allowed: {', '.join(self.choices)}"
        if self.low is None or self.high is None:
            return None
        number = isinstance(value, int if isinstance(self.default, int) else int | float) and not isinstance(
            value, bool
        )
        if not number or not self.low <= value <= self.high:  # type: ignore[operator]
            unit = f" {self.unit}" if self.unit else ""
            return f"parameter '{self.name}' is {value!r}; allowed are {self.low:g} to {self.high:g}{unit}"
        return None


PARAMETERS = (
    Parameter("scenario", "aerial_tramway", "name of a scenario, or path of its YAML file"),
    Parameter("set", "", "changes of the scenario by dotted key, KEY=VALUE, a line each, as in wind.x=12"),
    Parameter(
        "scenario_directories",
        "",
        "below which files of other scenarios may be that are loaded while the twin runs, with : between them, beside "
        "config, the record directory and the directory of the scenario",
    ),
    Parameter("snapshot", "", "file of ~/save_snapshot to go on from, with its own scenario"),
    Parameter("frame_rate", 100.0, "frames published in a second of simulated time", "Hz", 1.0, 1000.0),
    Parameter(
        "real_time_factor", 1.0, "simulated seconds in a second of the clock, 0 as fast as possible", "", 0.0, 1000.0
    ),
    Parameter("record", True, "write an MCAP bag, and a rerun recording as `rerun` says"),
    Parameter("record_directory", "cable_twin_logs", "where each run makes a directory of its own"),
    Parameter(
        "rerun",
        "file",
        "rerun recording: none, a file beside the bag, or that and a live view, for a viewer or also for a browser",
        choices=RERUN_MODES,
    ),
    Parameter(
        "split_duration", 3600.0, "simulated time after which the logs go on in new files, 0 never", "s", 0.0, 1e9
    ),
    Parameter("split_size", 0.0, "size of the bag's file from which on they do so as well, 0 any", "MB", 0.0, 1e9),
    Parameter("keep_age", 0.0, "files that ended so long ago are removed at the next split, 0 none", "s", 0.0, 1e9),
    Parameter(
        "keep_size", 0.0, "the oldest files are removed at a split until a run has this size, 0 none", "MB", 0.0, 1e9
    ),
    Parameter(
        "command_timeout", 0.5, "without a command for so long a moving carriage ramps to a stop", "s", 0.02, 3600.0
    ),
    Parameter(
        "command_max_age",
        0.0,
        "a command whose stamp is further from that of the newest frame is refused, 0: stamps do not count",
        "s",
        0.0,
        3600.0,
    ),
    Parameter("command_size", 65_536, "largest message that is taken as a command", "bytes", 1_024, 16_777_216),
    Parameter("command_rate", 1_000, "commands of topics that are taken in a second", "1/s", 1, 1_000_000),
    Parameter(
        "carrier_topics", "", "carriers that get topics of their own besides carriers/poses, as in chair_1,chair_7"
    ),
    *(
        Parameter(name, default, f"{text}; a whole fraction of frame_rate, or 0 for every frame", "Hz", 0.0, 1000.0)
        for name, default, text in (
            ("rope_rate", EVERY_FRAME, "how often cable is published"),
            ("path_rate", PUBLISHED["path"], "how often cable_path is published"),
            ("marker_rate", PUBLISHED["markers"], "how often markers is published"),
            ("log_joint_rate", EVERY_FRAME, "how often joint_states is logged"),
            ("log_pose_rate", LOGGED["poses"], "how often poses are logged"),
            ("log_force_rate", LOGGED["forces"], "how often forces are logged"),
            ("log_rope_rate", LOGGED["rope"], "how often cable is logged"),
            ("log_path_rate", LOGGED["path"], "how often cable_path is logged"),
            ("log_transform_rate", LOGGED["transforms"], "how often /tf is logged"),
            ("log_marker_rate", LOGGED["markers"], "how often markers is logged"),
        )
    ),
    Parameter(
        "frame_id",
        "map",
        "coordinate frame in which everything is; a name without spaces that does not begin with a slash",
        pattern=r"[^/\s]\S*",
    ),
    Parameter(
        "frame_prefix",
        "",
        "in front of the frames of vehicles, bodies and supports, as in south/; the same, or nothing",
        pattern=r"([^/\s]\S*)?",
    ),
    Parameter("allow_second", False, "start even where a twin of the same name runs in this ROS domain"),
    Parameter("start_paused", False, "wait for the service ~/pause or ~/step"),
    Parameter("step_count", 1, "frames that a call of ~/step takes while paused, as fast as they go", "", 1, 1_000_000),
    Parameter("publish_clock", False, "publish simulated time on /clock, for nodes with use_sim_time"),
)


def splitting_of(values: Mapping[str, Any]) -> Splitting:
    """Gather what the parameters of this name, by the values of all, say about splitting."""
    return Splitting(**{field.name: values[field.name] for field in fields(Splitting)})
