"""Table of the node's parameters: for ROS parameters, for the options of `sim` and for their help."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from cable_twin.frame.rates import EVERY_FRAME, LOGGED, PUBLISHED
from cable_twin.recording.splitting import Splitting

RERUN_MODES = ("none", "file", "live", "web")
FALSE = ("off", "false")  # accepted for "none"; YAML reads off as false
CHANGING = ("scenario", "command_timeout", "step_count", "readmit")  # parameters that may be set while the twin runs


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of the node: name, default, description, unit and range."""

    name: str
    default: str | bool | int | float
    description: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    pattern: str = ""  # of a valid text

    @property
    def placeholder(self) -> str:
        """Placeholder for the parameter's value in a usage line: unit or type."""
        return (
            self.unit.upper() or {bool: "{true,false}", str: "TEXT", int: "COUNT", float: "NUMBER"}[type(self.default)]
        )

    @property
    def help(self) -> str:
        """Description of a parameter with unit and range."""
        text = self.description
        if self.low is not None:
            text += f" ({self._range})"
        elif self.choices:
            text += f" ({', '.join(self.choices)})"
        return text

    def converted(self, value: Any) -> Any:
        """Value converted to the type of the parameter: an integer to a double, false to "none"."""
        if isinstance(self.default, float) and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
        if "none" in self.choices and (value is False or value in FALSE):
            return "none"
        return value

    def fault(self, value: object) -> str | None:
        """Message about an invalid value of the parameter; None for a valid one."""
        if self.pattern and not re.fullmatch(self.pattern, str(value)):
            return f"parameter '{self.name}': given '{value}'; allowed: {self.description}"
        if self.choices and value not in self.choices:
            return f"parameter '{self.name}': given '{value}'; allowed: {', '.join(self.choices)}"
        if self.low is None or self.high is None:
            return None
        number = isinstance(value, int if isinstance(self.default, int) else int | float) and not isinstance(
            value, bool
        )
        if not number or not self.low <= value <= self.high:  # type: ignore[operator]
            return f"parameter '{self.name}': given {value!r}; allowed: {self._range}"
        return None

    @property
    def _range(self) -> str:
        """Lowest and highest value of the parameter with unit; whole numbers in full."""
        form = "" if isinstance(self.default, int) else "g"
        return f"{self.low:{form}} to {self.high:{form}} {self.unit}".rstrip()


PARAMETERS = (
    Parameter("scenario", "aerial_tramway", "name of a shipped scenario, or path of a YAML file"),
    Parameter("set", "", "changed values of the scenario, a line KEY=VALUE with a dotted key each, as in wind.x=12"),
    Parameter(
        "scenario_directories",
        "",
        "directories, separated by :, from which scenario files may be loaded while the twin runs, besides the shipped "
        "ones, the record directory and the directory of the scenario at the start",
    ),
    Parameter("snapshot", "", "snapshot file to continue from, as ~/save_snapshot writes it, with the scenario in it"),
    Parameter("frame_rate", 100.0, "frames per second of simulated time", "Hz", 1.0, 1000.0),
    Parameter(
        "real_time_factor", 1.0, "simulated seconds per second of real time; 0: as fast as possible", "", 0.0, 1000.0
    ),
    Parameter("record", True, "write logs: an MCAP bag, and a rerun recording unless `rerun` is none"),
    Parameter("record_directory", "cable_twin_logs", "directory in which each run gets a subdirectory"),
    Parameter(
        "rerun",
        "file",
        "rerun recording. none: no recording; file: a file beside the bag; live: also a live view for a rerun viewer; "
        "web: also for a browser",
        choices=RERUN_MODES,
    ),
    Parameter("split_duration", 3600.0, "simulated time after which new log files begin; 0: never", "s", 0.0, 1e9),
    Parameter("split_size", 0.0, "size of the MCAP file at which new log files begin; 0: no limit", "MB", 0.0, 1e9),
    Parameter(
        "keep_age",
        0.0,
        "whenever new files begin, those that ended longer ago than this are deleted; 0: keep all",
        "s",
        0.0,
        1e9,
    ),
    Parameter(
        "keep_size",
        0.0,
        "whenever new files begin, the oldest are deleted until the run is no larger than this; 0: keep all",
        "MB",
        0.0,
        1e9,
    ),
    Parameter(
        "command_timeout",
        0.5,
        "time without a command after which a moving carriage or drive ramps to a stop",
        "s",
        0.02,
        3600.0,
    ),
    Parameter(
        "command_max_age",
        0.0,
        "commands whose stamp differs by more than this from the stamp of the newest frame are "
        "refused; 0: stamps are ignored",
        "s",
        0.0,
        3600.0,
    ),
    Parameter(
        "command_size",
        65_536,
        "largest command message that is accepted; larger ones are refused undecoded",
        "bytes",
        1_024,
        16_777_216,
    ),
    Parameter(
        "command_rate",
        1_000,
        "commands per second that are accepted, all topics together; more are refused",
        "1/s",
        1,
        1_000_000,
    ),
    Parameter(
        "carrier_topics",
        "",
        "carriers that also get topics of their own, besides carriers/poses, as in chair_1,chair_7",
    ),
    *(
        Parameter(
            name, default, f"{text}; frame_rate divided by a whole number, or 0 for every frame", "Hz", 0.0, 1000.0
        )
        for name, default, text in (
            ("rope_rate", EVERY_FRAME, "rate at which ~/cable is published"),
            ("path_rate", PUBLISHED["path"], "rate at which ~/cable_path is published"),
            ("marker_rate", PUBLISHED["markers"], "rate at which ~/markers is published"),
            ("log_joint_rate", EVERY_FRAME, "rate at which ~/joint_states is logged"),
            ("log_pose_rate", LOGGED["poses"], "rate at which poses are logged"),
            ("log_force_rate", LOGGED["forces"], "rate at which forces are logged"),
            ("log_rope_rate", LOGGED["rope"], "rate at which ~/cable is logged"),
            ("log_path_rate", LOGGED["path"], "rate at which ~/cable_path is logged"),
            ("log_transform_rate", LOGGED["transforms"], "rate at which /tf is logged"),
            ("log_marker_rate", LOGGED["markers"], "rate at which ~/markers is logged"),
        )
    ),
    Parameter(
        "frame_id",
        "map",
        "coordinate frame of all positions; a name without spaces that does not begin with a slash",
        pattern=r"[^/\s]\S*",
    ),
    Parameter(
        "frame_prefix",
        "",
        "prefix of the coordinate frames of vehicles, bodies and supports, as in south/; without spaces, not beginning "
        "with a slash, or empty",
        pattern=r"([^/\s]\S*)?",
    ),
    Parameter(
        "outlook",
        True,
        "publish ~/outlook: what happens if the emergency stop comes now, if all goes on as commanded, and in a gust; "
        "from a process beside the twin at a lower priority",
    ),
    Parameter("outlook_horizon", 60.0, "how far ahead ~/outlook looks", "s", 1.0, 3600.0),
    Parameter("outlook_rate", 1.0, "outlooks a second, fewer where one takes longer", "Hz", 0.01, 10.0),
    Parameter(
        "outlook_gust",
        10.0,
        "amplitude of the announced gust of ~/outlook, across the track in space, along it in a plane",
        "m/s",
        0.1,
        100.0,
    ),
    Parameter(
        "follow",
        False,
        "follow the plant that publishes under /plant/: its drives, and ~/estimate with what its sensors tell of "
        "hidden quantities; from a process beside the twin at a lower priority",
    ),
    Parameter(
        "readmit",
        "",
        "set while the twin follows a plant: name of a sensor that is left out or taken for another, which counts "
        "again from then on; it is empty again at once",
    ),
    Parameter("allow_second", False, "start even if a twin of the same name already runs in this ROS domain"),
    Parameter("start_paused", False, "start paused, until the service ~/pause or ~/step is called"),
    Parameter(
        "step_count", 1, "frames that one call of ~/step advances a paused twin, as fast as possible", "", 1, 1_000_000
    ),
    Parameter("publish_clock", False, "publish simulated time on /clock, for nodes with use_sim_time"),
)


def splitting_of(values: Mapping[str, Any]) -> Splitting:
    """Options for splitting the log into files, from the node parameters of the same names."""
    return Splitting(**{field.name: values[field.name] for field in fields(Splitting)})
