"""The command `sim`: start the node, end it cleanly."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Sequence

from cable_twin.ros.parameters import PARAMETERS

INSTALL_HINT = (
    "{command} needs rclpy, which this Python does not have: install the ROS 2 wheels with\n"
    "    pip install 'cable_twin[ros]'      (in a clone: pip install '.[ros]')\n"
    "or source a ROS 2 workspace first: source /opt/ros/jazzy/setup.sh"
)

EPILOG = """\
Each option is a parameter of the node, so that `--ros-args -p NAME:=VALUE` and parameter files work as well.

examples:
  sim                                    the default scenario in real time
  sim --scenario seed_example            the example of the paper
  sim --rerun live                       watch it: rerun rerun+http://127.0.0.1:9876/proxy
"""


def parser() -> argparse.ArgumentParser:
    """Options of `sim`: one for each parameter of the node."""
    result = argparse.ArgumentParser(
        prog="sim",
        description="The live twin of a ropeway: a ROS 2 node that solves it in real time and logs it.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for parameter in PARAMETERS:
        option = f"--{parameter.name.replace('_', '-')}"
        text = f"{parameter.help}; default: {str(parameter.default).lower()}"
        if isinstance(parameter.default, bool):
            result.add_argument(option, dest=parameter.name, choices=("true", "false"), help=text)
        else:
            kind = type(parameter.default)
            result.add_argument(option, dest=parameter.name, type=kind, help=text, metavar=kind.__name__.upper())
    return result


def ros_arguments(argv: Sequence[str]) -> list[str]:
    """Turn the options of `sim` into ROS arguments, and keep those that are."""
    split = list(argv).index("--ros-args") if "--ros-args" in argv else len(argv)
    given = vars(parser().parse_args(list(argv[:split])))
    arguments = ["--ros-args"]
    for name, value in given.items():
        if value is not None:
            # a string in quotes, or YAML would read a path like 1e3 as a number
            quoted = f'"{value}"' if isinstance(value, str) and value not in ("true", "false") else str(value)
            arguments += ["-p", f"{name}:={quoted}"]
    return arguments + list(argv[split + 1 :])


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; 0 after a clean end, 1 when it could not start."""
    arguments = ros_arguments(sys.argv[1:] if argv is None else argv)
    try:
        import rclpy  # noqa: PLC0415 - the message below stands for the traceback
        from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415
        from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    except ImportError:
        print(INSTALL_HINT.format(command="sim"), file=sys.stderr)
        return 1
    from cable_twin.ros.node import ParameterError, TwinNode  # noqa: PLC0415
    from cable_twin.scenario import ScenarioError  # noqa: PLC0415
    from cable_twin.simulation import EquilibriumError  # noqa: PLC0415

    # a flag of our own: rclpy's handlers would end the context before the logs are closed, and `ros2 launch` sends
    # SIGINT twice
    ending = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ending.set())
    try:
        rclpy.init(args=["sim", *arguments], signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        print(f"sim: {str(error).splitlines()[0]}", file=sys.stderr)
        return 1
    try:
        node = TwinNode()
    except (ParameterError, ScenarioError, EquilibriumError, OSError) as error:
        for line in str(error).splitlines():
            print(f"sim: {line}", file=sys.stderr)
        rclpy.try_shutdown()
        return 1
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.start()
    try:
        while not ending.is_set():
            executor.spin_once(timeout_sec=0.2)
    finally:
        node.stop()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
