"""Command `sim`: start the node and end it cleanly."""

from __future__ import annotations

import gc
import json
import os
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from cable_twin.basics.cpu import hold_numpy_to_the_class
from cable_twin.basics.printable import printable, printable_lines
from cable_twin.ros.parameter_table import PARAMETERS
from cable_twin.ros.startup import (
    Ending,
    new_executor,
    prepare_middleware,
    print_hint,
    rcl_fault,
)
from cable_twin.terminal.command_line import OneLineParser, faults_reported, split_ros_arguments

if TYPE_CHECKING:
    from cable_twin.ros.node import TwinNode

UNFINISHED = ("reading", "loading")  # threads that read and build a scenario
EPILOG = """\
Each option is a parameter of the node, so that `--ros-args -p NAME:=VALUE` and parameter files work as well.

examples:
  sim                                    the default scenario in real time
  sim seed_example                       the example of the paper; as sim --scenario seed_example
  sim windy_tramway --set wind.y=15      with a changed value, by dotted key
  sim --list                             the scenarios, a line each
  sim --snapshot snapshot_60.000_s.npz   continue from a state that ~/save_snapshot wrote
  sim --rerun web                        watch it in a browser; it prints the link
  sim --rerun live                       watch it: rerun --bind 127.0.0.1 --connect
  sim --ros-args -r __ns:=/b             a second twin in this domain, under a name of its own
  drive cabin --speed 5                  in another terminal: drive the cabin
"""

LINGER = 0.5  # s in which the caller gets the answer to a loaded scenario, before the node is replaced
SWITCH_INTERVAL = 0.0005  # s that a due frame may wait for another thread's Python; 5 ms by default


def parser() -> OneLineParser:
    """Build the argument parser of `sim`, with an option for each parameter of the node."""
    result = OneLineParser(
        "sim", "The live twin of a ropeway: a ROS 2 node that solves it in real time and logs it.", EPILOG
    )
    for parameter in PARAMETERS:
        if parameter.name == "scenario":
            result.add_scenario(f"{parameter.help}; default: {parameter.default}", _scenario_lines)
            continue
        if parameter.name == "set":
            text = "change a value of the scenario by its dotted key, as in wind.x=12; may be repeated"
            result.add_argument("--set", action="append", metavar="KEY=VALUE", help=text)
            continue
        result.add_argument(
            f"--{parameter.name.replace('_', '-')}",
            dest=parameter.name,
            type=type(parameter.default) if type(parameter.default) in (int, float) else str,
            choices=("true", "false") if isinstance(parameter.default, bool) else None,
            nargs="?" if isinstance(parameter.default, bool) else None,
            const="true" if isinstance(parameter.default, bool) else None,
            metavar=parameter.placeholder,
            help=f"{parameter.help}; default: {_text(parameter.default)}",
        )
    return result


def ros_arguments(argv: Sequence[str]) -> list[str]:
    """Convert the options of `sim` into ROS arguments, and keep given ROS arguments."""
    own, for_ros = split_ros_arguments(argv)
    options = parser()
    parsed = options.parse_args(own)
    changes = None if parsed.set is None else "\n".join(parsed.set)
    given = {**vars(parsed), "scenario": options.given_scenario(parsed), "set": changes}
    arguments = ["--ros-args"]
    for parameter in PARAMETERS:
        value = given[parameter.name]
        if value is not None:
            # a text in quotes, or YAML would read a path like 1e3 as a number
            quoted = json.dumps(value, ensure_ascii=False) if isinstance(parameter.default, str) else value
            arguments += ["-p", f"{parameter.name}:={quoted}"]
    return arguments + for_ros[1:]


@faults_reported("sim")
def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; returns 0 after a clean end, 1 after a failed start or a fault."""
    arguments = ros_arguments(sys.argv[1:] if argv is None else argv)
    ending = Ending("sim")
    hold_numpy_to_the_class()
    try:
        import rclpy  # noqa: PLC0415 - the hint stands for the traceback
        from rclpy.exceptions import ParameterException  # noqa: PLC0415
        from rclpy.impl.implementation_singleton import rclpy_implementation  # noqa: PLC0415
        from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415

        from cable_twin.ros.node import SecondTwinError, TwinNode  # noqa: PLC0415
        from cable_twin.ros.parameters import ParameterError  # noqa: PLC0415
    except ImportError as error:
        print_hint("sim", error)
        return 1
    from cable_twin.scenario import ScenarioError  # noqa: PLC0415
    from cable_twin.simulation import EquilibriumError, SnapshotError  # noqa: PLC0415

    prepare_middleware("sim")
    try:
        rclpy.init(args=["sim", *arguments], signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        print(f"sim: {rcl_fault(error)}", file=sys.stderr)
        return 1
    fault = ""
    try:
        node = TwinNode(arguments=arguments)
    except (ParameterError, SecondTwinError, ScenarioError, EquilibriumError, SnapshotError) as error:
        fault = str(error)
    except (ParameterException, rclpy_implementation.RCLError) as error:
        fault = rcl_fault(error)
    if fault:
        return _refuse_start(fault)
    ending.starting = False
    sys.setswitchinterval(SWITCH_INTERVAL)
    try:
        _run(node, ending)
        while node.loading.loaded is not None and not ending.is_set():
            node = _next(node)
            _run(node, ending)
    except (ParameterError, SecondTwinError) as error:
        return _refuse_start(str(error))
    finally:
        node.emergency.close()
        rclpy.try_shutdown()
        ending.close()
    return _ended(1 if node.failed else 0)


def _ended(code: int) -> int:
    """Return the exit code of `sim`; end the process here if a scenario is still being read or built.

    At its own end Python would stop such a thread by force, in the middle of compiled code, which crashes.
    """
    if any(one.name in UNFINISHED for one in threading.enumerate()):
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):  # nobody reads it any more
                stream.flush()
        os._exit(code)
    return code


def _run(node: TwinNode, ending: Ending) -> None:
    """Run a node until a signal, a fault of the program, or the loading of another scenario."""
    from cable_twin.terminal.bars import StatusBar  # noqa: PLC0415 - as above

    executor = new_executor()
    executor.add_node(node)
    bar = StatusBar(node.status.text, sys.stdout, sys.stderr)
    try:
        node.start()
        bar.start()
        while not ending.is_set() and not node.failed and node.loading.loaded is None:
            executor.spin_once(timeout_sec=0.2)
        until = time.monotonic() + LINGER
        while node.loading.loaded is not None and time.monotonic() < until:
            executor.spin_once(timeout_sec=0.05)
    finally:
        bar.stop()
        node.stop()
        executor.shutdown()
        node.destroy_node()


def _next(node: TwinNode) -> TwinNode:
    """Make the node of a newly loaded scenario, or of the previous scenario where the loaded one fails."""
    from cable_twin.ros.node import TwinNode  # noqa: PLC0415
    from cable_twin.ros.parameters import inherited  # noqa: PLC0415 - as above

    loading, fault = node.loading, ""
    try:
        return TwinNode(loading.loaded, inherited(node, loading.source, paused=loading.paused), node.emergency)
    except Exception as error:  # no loaded scenario may end the running twin
        fault = printable_lines(error)
    gc.collect()  # so that the entities of the failed node give up their names
    print(
        f"sim: '{printable(loading.source)}' does not run: {fault}; the previous scenario keeps running",
        file=sys.stderr,
    )
    return TwinNode(node.simulation, inherited(node, loading.before, paused=loading.paused_before), node.emergency)


def _refuse_start(faults: str) -> int:
    """Print the reasons of a failed start, a line each; returns the exit code."""
    import rclpy  # noqa: PLC0415

    for line in faults.splitlines():
        print(f"sim: {line}", file=sys.stderr)
    gc.collect()  # entities of the node have to go before the context, or rclpy crashes
    rclpy.try_shutdown()
    return 1


def _scenario_lines() -> list[str]:
    from cable_twin.scenario import scenario_lines  # noqa: PLC0415 - half a second

    return scenario_lines()


def _text(default: object) -> str:
    """Default value of an option as typed on the command line."""
    return f"{default:g}" if isinstance(default, float) else str(default).lower() or "none"


if __name__ == "__main__":
    sys.exit(main())
