"""Command `plant_door`: publish tags of a plant without ROS as topics, and serve the estimates of its twin."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

from cable_twin.basics.units import counted
from cable_twin.ros.door.map_file import MapError, Warned, connections, open_to_others, read_map
from cable_twin.ros.door.plant_map import Mqtt
from cable_twin.ros.startup import (
    Ending,
    new_executor,
    prepare_middleware,
    print_hint,
    rcl_fault,
)
from cable_twin.terminal.command_line import (
    OneLineParser,
    faults_reported,
    print_line,
    report_fault,
    split_ros_arguments,
    tell,
    typed,
)

UNUSABLE = 2  # exit code
EXTRAS = {"asyncua": "opcua", "paho": "mqtt"}
EPILOG = """\
MAP names servers (`opcua`), brokers (`mqtt`), and for each tag its address, what it measures, of what, and its unit.
Values become SI units on topics under /plant/, as `plant` has them, with the stamp of their measurement by the clock of
this machine. With `server` in MAP the door is an OPC UA server too, with the estimates and alarms of the twin.

A tag with a fault is left out with a line; so are samples of bad quality, that are no finite number, or out of the
range in MAP. Lost connections are tried again until Ctrl-C. Names and passwords come from the environment or files.

exit codes: 0 ended by Ctrl-C or SIGTERM, or --check found no fault; 1 without ROS 2 or a library; 2 wrong map or
option, or --check found a fault

examples:
  plant_door plant.yaml --check        what becomes of each tag, without a connection
  plant_door plant.yaml
  plant_door plant.yaml --ros-args -r /plant/wind:=/plant/north/wind
  ros2 topic echo /plant/joint_states
"""


def parser() -> OneLineParser:
    """Parser of the options of `plant_door`."""
    result = OneLineParser(
        "plant_door",
        "Bring tags of OPC UA and MQTT to topics of a plant, and estimates back.",
        EPILOG,
        failure=UNUSABLE,
    )
    result.add_argument("map", type=Path, metavar="MAP", help="YAML file with connections and tags")
    result.add_argument("--check", action="store_true", help="print what becomes of each tag, and all faults, and end")
    return result


@faults_reported("plant_door")
def main(argv: Sequence[str] | None = None) -> int:
    """Run `plant_door` until SIGINT or SIGTERM; returns the exit code, as described in its help."""
    own, for_ros = split_ros_arguments(sys.argv[1:] if argv is None else argv)
    options = parser().parse_args(own)
    ending = Ending("plant_door")
    try:
        read = read_map(options.map)
    except MapError as error:
        tell("plant_door", error)
        return UNUSABLE
    for line in (*read.left_out, *read.warnings, *_open_files(read, options.map.parent)):
        tell("plant_door", line)
    if options.check:
        return _check(read)
    if hint := _missing(read):
        tell("plant_door", hint)
        return 1
    try:
        import rclpy  # noqa: PLC0415 - the hint stands for the traceback
        from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415

        from cable_twin.ros.door.door import Door  # noqa: PLC0415
        from cable_twin.ros.parameters import ParameterError  # noqa: PLC0415
    except ImportError as error:
        print_hint("plant_door", error)
        return 1
    prepare_middleware("plant_door")
    try:
        rclpy.init(args=["plant_door", *for_ros], signal_handler_options=SignalHandlerOptions.NO)
        door = Door(read.plan, options.map.parent)
    except Exception as error:
        tell("plant_door", rcl_fault(error))
        gc.collect()
        rclpy.try_shutdown()
        return 1
    ending.starting = False
    executor = new_executor()
    executor.add_node(door.node)

    def spin(condition: Callable[[], bool], seconds: float) -> None:
        until = time.monotonic() + seconds
        while not condition() and not ending.is_set() and (left := until - time.monotonic()) > 0.0:
            executor.spin_once(timeout_sec=min(left, 0.1))

    code = 0
    try:
        door.start(spin)
        _announce(door.node, read)
        while not ending.is_set() and not code:
            spin(lambda: False, door.TURN)
            door.turn()
            for fault in door.faults[:1]:
                code = report_fault("plant_door", fault)
    except ParameterError as error:
        tell("plant_door", error)
        code = UNUSABLE
    finally:
        door.close()
        executor.shutdown()
        rclpy.try_shutdown()
        ending.close()
    return code


def _announce(node: object, read: Warned) -> None:
    plan = read.plan
    count = len(plan.tags)
    out = f", {len(read.left_out)} left out" if read.left_out else ""
    where = ", ".join([*plan.opcua, *plan.mqtt]) or "no connection"
    node.get_logger().info(f"{counted(count, 'tag')} of {where}{out}; Ctrl-C ends the door")  # type: ignore[attr-defined]


def _check(read: Warned) -> int:
    """Print the topic and quantity that each tag of a map becomes; returns the exit code."""
    from cable_twin.ros.door.tags_to_messages import topic_of  # noqa: PLC0415 - half a second

    plan = read.plan
    wide = max(map(len, plan.tags), default=0)
    for name, tag in plan.tags.items():
        where = f"{tag.source} {tag.address}{f' {tag.field}' if tag.field else ''} [{tag.unit}]"
        of = " ".join(filter(None, (tag.of, tag.quantity, tag.axis)))
        print_line(f"{name:<{wide}}  {where} -> {topic_of(tag)}: {of}")
    if plan.server is not None:
        print_line(f"{'server':<{wide}}  estimates of {plan.server.twin} -> {plan.server.url}")
    return UNUSABLE if read.left_out else 0


def _open_files(read: Warned, directory: Path) -> list[str]:
    """Lines about files of secrets that other users of the machine can read."""
    return [
        f"{path}.{key}: other users of this machine can read {secret.file}; chmod 600 keeps them from it"
        for path, one in connections(read.plan)
        for key in ("user", "password", "private_key_password")
        if key != "user" and (secret := getattr(one, key)) is not None and open_to_others(secret, directory)
    ]


def _missing(read: Warned) -> str:
    """Line about missing libraries for the connections of a map; empty where all are installed."""
    needed = {"paho" if isinstance(one, Mqtt) else "asyncua" for _, one in connections(read.plan)}
    missing = sorted(EXTRAS[name] for name in needed if find_spec(name) is None)
    if not missing:
        return ""
    return f"{' and '.join(missing)} cannot be spoken: {typed('pip')} install 'cable_twin[{','.join(missing)}]'"


if __name__ == "__main__":
    sys.exit(main())
