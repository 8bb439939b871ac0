"""Lock for one twin per name in a ROS domain: two would take and publish on identical topics."""

from __future__ import annotations

import errno
import socket
from hashlib import sha256

from rclpy.node import Node

from cable_twin.messages import SCENARIO


class SecondTwinError(RuntimeError):
    """Twin with an identical name in the ROS domain, in one line."""


def hold_name(node: Node) -> socket.socket:
    """Hold the name of a node for the lifetime of this process and of the returned socket.

    On this machine it is held at once, however busy DDS is; twins of other machines are in `check_others`.

    Raises:
        SecondTwinError: another process of this machine holds it.
    """
    held = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        # an abstract name: no file is left behind, and it is seen as far as this machine's network is
        name = f"{node.context.get_domain_id()}{node.get_fully_qualified_name()}"
        held.bind(f"\0cable_twin/{sha256(name.encode()).hexdigest()}")
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            held.close()
            raise SecondTwinError(_line(node)) from None
    return held


def check_others(node: Node) -> None:
    """Refuse the name of a twin on another machine; called before the node publishes its scenario.

    Raises:
        SecondTwinError: there is one.
    """
    if node.count_publishers(node.resolve_topic_name(f"~/{SCENARIO}")):
        raise SecondTwinError(_line(node))


def _line(node: Node) -> str:
    return (
        f"a twin named {node.get_fully_qualified_name()} runs already in ROS domain {node.context.get_domain_id()}: "
        "give this one another name, as with --ros-args -r __ns:=/b, or allow both with --allow-second"
    )
