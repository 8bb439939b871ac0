"""Command `drive`: commands to a running twin from a terminal, without the ros2 command line."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.status import Status

from cable_twin.basics.printable import printable_lines
from cable_twin.frame.commands import KINDS, Kind
from cable_twin.ros.client.shown import SHOWN, show
from cable_twin.ros.client.twin_client import TwinClient, TwinError, list_twins
from cable_twin.ros.startup import Ending, prepare_middleware, print_hint, rcl_fault
from cable_twin.terminal.command_line import (
    INTERRUPTED,
    OneLineParser,
    faults_reported,
    number,
    split_ros_arguments,
    whole_number,
)

DISCOVERY = 10.0  # s to find the twin, unless --wait is given
# requests that are no commands: service, its argument, and help
ACTIONS: dict[str, tuple[str, bool | None, str]] = {
    "pause": ("pause", True, "pause the simulation"),
    "resume": ("pause", False, "resume the simulation"),
    "snapshot": ("save_snapshot", None, "write the full state to a file and print its path"),
}
COMMANDS = {name: kind for name, kind in KINDS.items() if kind.topic or kind.service}  # all but gusts
EPILOG = """\
--speed and --force are sent again and again until Ctrl-C or the end of --duration; then the twin is told to stop. (If
`drive` is killed, the twin stops by itself after `command_timeout`.) --to ends when the vehicle stands within 0.1 m of
the place. Everything else is sent once, and the answer is printed.

exit codes: 0 done, 1 no twin, refused or a wrong option, 130 ended by Ctrl-C before the twin had answered

examples:
  drive cabin --speed 5                  5 m/s along the cable, at the drive's own acceleration
  drive cabin --speed -3 --ramp 20       to -3 m/s within 20 s
  drive cabin --force 40000 --duration 10
  drive cabin --to upper_station         there, and stop; also lower_station, start, end, and towers by name
  drive haul_rope --to end               of a drive: start and end of its travel (m), or a place between
  drive cabin --to 420 --at-most 5       to 420 m along the cable, with 5 m/s on the way
  drive cabin --payload 3200             kg, in a station
  drive --wind 12                        m/s along the track, with a second number upwards, a third to the left
  drive --temperature -5                 degC, of all ropes
  drive --emergency-stop                 and drive --release
  drive --pause                          and drive --step 10, drive --resume
  drive --snapshot
  drive --load gondola                   the same twin with another scenario; also the path of a YAML file
  drive --readmit load_tower             a sensor of a plant, which its twin has left out, counts again
  drive --list                           the twins of this domain
  drive --show figures                   also state, outlook, and estimate of a twin that follows its plant
  drive cabin --speed 5 --ros-args -r __ns:=/b \\
        -r /b/cable_twin/joint_commands:=/b/desk
"""
USAGE = """\
drive [-h] [--node NODE] [--wait S] ... and one of
       drive NAME (--speed M/S | --force N) [--ramp S] [--duration S]
       drive NAME (--payload KG | --to PLACE [--at-most M/S])
       drive (--wind M/S [M/S ...] | --temperature DEGC)
       drive (--emergency-stop | --release | --reset | --pause | --resume)
       drive (--step N | --snapshot | --load SCENARIO | --readmit SENSOR)
       drive (--list | --show {state,figures,outlook,estimate})"""


def parser() -> OneLineParser:
    """Build the argument parser of `drive`, with options for all kinds of commands, services and queries."""
    result = OneLineParser("drive", "Send commands to a running twin from a terminal.", EPILOG)
    result.add_argument("name", nargs="?", help="carriage or drive, such as cabin or haul_rope")
    result.usage = USAGE  # argparse breaks so long a choice within a word
    any_number, duration = number(-math.inf, math.inf, zero=True), number(0.0, math.inf, "s", zero=True)
    what = result.add_mutually_exclusive_group(required=True)
    for kind in COMMANDS.values():
        option, unit = _option(kind), kind.unit.upper()
        if kind.axes:
            several = "+" if len(kind.axes) > 1 else 1
            what.add_argument(option, type=any_number, nargs=several, help=f"{kind.unit}: {kind.help}", metavar=unit)
        elif kind.quantity:
            what.add_argument(option, type=any_number, help=f"{kind.unit}: {kind.help}", metavar=unit)
        else:
            what.add_argument(option, action="store_true", help=kind.help)
    for action, (_, _, text) in ACTIONS.items():
        what.add_argument(f"--{action}", action="store_true", help=text)
    what.add_argument("--step", type=whole_number(1), metavar="N", help="advance a paused twin by N frames")
    what.add_argument(
        "--to",
        metavar="PLACE",
        help="let the twin drive to a place and stop there: of a carriage m along the cable, a station, start, end or "
        "a tower; of a drive m of its travel, start or end",
    )
    what.add_argument("--load", metavar="SCENARIO", help="start another scenario in the running twin, with new logs")
    what.add_argument(
        "--readmit", metavar="SENSOR", help="let a sensor count again that a twin which follows its plant has left out"
    )
    what.add_argument("--list", action="store_true", help="list the twins of this ROS domain with their state")
    what.add_argument("--show", choices=[*SHOWN], help="print what the twin publishes next of these, and end")
    result.add_argument(
        "--at-most",
        type=any_number,
        metavar="M/S",
        help="m/s: highest speed on the way --to a place; default: the limit of the drive",
    )
    result.add_argument(
        "--ramp", type=duration, metavar="S", help="s: time in which the value is reached from zero; default: 0"
    )
    result.add_argument("--duration", type=duration, metavar="S", help="s: time to drive; default: until Ctrl-C")
    result.add_argument(
        "--node", type=_node, help="full name of the twin; default: /cable_twin, in the namespace of this command"
    )
    result.add_argument(
        "--wait",
        type=duration,
        default=DISCOVERY,
        metavar="S",
        help=f"s: time to wait for the twin, which compiles its solver on its first start; default: {DISCOVERY:g}",
    )
    return result


@faults_reported("drive")
def main(argv: Sequence[str] | None = None) -> int:
    """Send a command to a twin; returns 0 at the end, 1 without a twin or after a refusal, 130 after an interrupt."""
    own, for_ros = split_ros_arguments(sys.argv[1:] if argv is None else argv)
    arguments = parser()
    options = arguments.parse_args(own)
    given = {kind.name: getattr(options, kind.name) for kind in COMMANDS.values()}
    kind = next((COMMANDS[name] for name, value in given.items() if value is not None and value is not False), None)
    if fault := _fault(options, kind):
        arguments.error(fault)
    ending = Ending("drive")
    try:
        import rclpy  # noqa: PLC0415 - the hint stands for the traceback
        import sensor_msgs.msg  # noqa: F401, PLC0415
        from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    except ImportError as error:
        print_hint("drive", error)
        return 1
    ending.starting = False
    prepare_middleware("drive")
    try:
        rclpy.init(args=["drive", *for_ros], signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node("cable_twin_drive")
    except Exception as error:
        print(f"drive: {rcl_fault(error)}", file=sys.stderr)
        return 1
    if options.node is None:  # the one beside it, also where a launch file pushes a namespace
        options.node = f"{node.get_namespace().rstrip('/')}/cable_twin"
    try:
        if (kind is not None and kind.drives) or options.to is not None:
            _drive(node, kind, options, ending)
        else:
            _request(node, kind, options, ending)
    except KeyboardInterrupt:
        return INTERRUPTED
    except TwinError as error:
        print(f"drive: {printable_lines(error)}", file=sys.stderr)
        return 1
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _fault(options: argparse.Namespace, kind: Kind | None) -> str:
    """Message about incompatible options of `drive`, empty for compatible ones."""
    if options.to is not None and options.name is None:
        return "NAME: given nothing; allowed: a carriage or drive, before --to"
    if options.at_most is not None and (options.to is None or options.at_most <= 0.0):
        return f"--at-most: given {options.at_most:g} m/s; allowed: more than 0 m/s, with --to"
    if kind is not None and kind.axes:
        count = len(getattr(options, kind.name)) + _is_number(options.name)
        if count > len(kind.axes):
            most = f"at most {len(kind.axes)}, of" if len(kind.axes) > 1 else "one, of all"
            allowed = f"{most} {', '.join(kind.axes)}, in {kind.unit}"
            return f"argument {_option(kind)}: given {count} numbers; allowed: {allowed}"
    named = kind is not None and bool(kind.quantity) and not kind.axes
    if named and options.name is None:
        assert kind is not None
        return f"NAME: given nothing; allowed: a carriage{' or drive' if kind.drives else ''}, before {_option(kind)}"
    if not named and options.name is not None and options.to is None:
        allowed = _options(lambda kind: kind.quantity and not kind.axes)
        return f"NAME: given '{options.name}'; allowed: with {allowed}, --to"
    for name in ("ramp", "duration"):
        if getattr(options, name) is not None and not (kind is not None and kind.drives):
            return f"--{name}: given {getattr(options, name):g} s; allowed: with {_options(lambda kind: kind.drives)}"
    return ""


def _is_number(text: str | None) -> bool:
    """Whether a given NAME is a number, one more of the option before it."""
    try:
        return math.isfinite(float(text or "nan"))
    except ValueError:
        return False


def _options(wanted: Callable[[Kind], object]) -> str:
    return ", ".join(_option(kind) for kind in COMMANDS.values() if wanted(kind))


def _option(kind: Kind) -> str:
    return f"--{kind.name.replace('_', '-')}"


def _waiting(text: str) -> Status:
    """Show a progress message on a terminal while DDS takes seconds to find other nodes."""
    return Console(stderr=True).status(text)


def _drive(node: Any, kind: Kind | None, options: argparse.Namespace, ending: Ending) -> None:
    """Send a speed or force to the twin again and again until its end condition, or a trip to a place."""
    from cable_twin.ros.client.driver import Driver, Trip  # noqa: PLC0415 - an emergency stop does without

    driver = (
        Trip(node, options, ending)
        if kind is None
        else Driver(node, kind, getattr(options, kind.name), options, ending)
    )
    with _waiting(f"looking for {options.node}"):
        driver.find_twin()
    driver.run()


def _request(node: Any, kind: Kind | None, options: argparse.Namespace, ending: Ending) -> None:
    """Send one request to the twin and print its answer."""
    if options.list:
        with _waiting("looking for twins"):
            lines = list_twins(node, options.wait, ending)
        if not lines:
            wait = options.wait
            raise TwinError(f"no twin found after {wait:g} s: is `sim` running, with the same ROS_DOMAIN_ID?")
        print(*lines, sep="\n")
        return
    if options.show is not None:
        with _waiting(f"listening to {options.node}"):
            lines = show(node, options.node, options.show, options.wait, ending)
        print(*lines, sep="\n")
        return
    client = TwinClient(node, options.node, options.wait, ending)
    with _waiting(f"asking {options.node}"):
        answer = _ask(client, kind, options)
    print(f"{options.node}: {answer}")


def _ask(client: TwinClient, kind: Kind | None, options: argparse.Namespace) -> str:
    """Send one request to the twin; returns the answer."""
    if kind is None:
        if options.step is not None:
            return client.step(options.step)
        if options.load is not None:
            return client.load(str(Path(options.load).absolute()) if Path(options.load).suffix else options.load)
        if options.readmit is not None:
            return client.readmit(options.readmit)
        service, switch, _ = next(action for name, action in ACTIONS.items() if getattr(options, name))
        return client.call(service, switch)
    if kind.service:
        return client.call(kind.service, kind.switch)
    given = getattr(options, kind.name)
    if kind.axes:
        return client.give(kind, kind.by_axis(dict(zip(kind.axes, given, strict=False))))
    return client.give(kind, {options.name: given})


def _node(text: str) -> str:
    """Parse the full name of a node from an option."""
    name = f"/{text.strip('/')}"
    if not re.fullmatch(r"(/[A-Za-z_]\w*)+", name, re.ASCII):
        raise argparse.ArgumentTypeError(f"given {text!r}; allowed: the full name of a node, such as /b/cable_twin")
    return name


if __name__ == "__main__":
    sys.exit(main())
