"""Plant that speaks OPC UA and no ROS: a scenario in real time whose sensors are variables, for `plant_door`.

    .venv/bin/python examples/opcua_plant.py [SCENARIO] [--url URL] [--set KEY=VALUE] [--clock S] [--speed M/S]

Its carriage shuttles between 5 % and 95 % of its rope. It stands for 20 s at each end and before its first trip, where
a twin that follows it can begin. Variables are `ns=2;s=NAME.QUANTITY`, in the units that plants have: position (m),
speed (km/h), drive_force, force_x and force_z of supports (kN), tilt (deg), speed_command (m/s).
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import math
import sys
import time
from datetime import datetime, timedelta, timezone
from functools import partial
from typing import Any

from asyncua import Server, ua
from rich.console import Console

from cable_twin.frame.sensors import Measurement, Sensors
from cable_twin.offline.plant import plant_of
from cable_twin.offline.simulate_options import add_changes
from cable_twin.scenario import ScenarioError
from cable_twin.terminal.bars import compilation_shown
from cable_twin.terminal.command_line import OneLineParser, left_at_once, tell

FRAME = 0.02  # s
ENDS = 0.05, 0.95  # shares of the rope between which the carriage goes
STAY = 20.0  # s, for which it stands there
BRAKING = 60.0  # m before an end at which the speed is reduced
QUANTITIES = {  # of each kind of sensor: variable, row of its values, factor
    "encoder": (("position", 0, 1.0), ("speed", 1, 3.6)),
    "drive_force": (("drive_force", 0, 1e-3),),
    "load_cell": (("force_x", 0, 1e-3), ("force_z", 2, 1e-3)),
    "inclinometer": (("tilt", 0, 180.0 / math.pi),),
}


class UnusableError(ValueError):
    """Error of an option that the plant cannot use; the message is one line."""


class Plant:
    """Simulated plant with its server.

    Args:
        options: of the command.

    Raises:
        UnusableError: the scenario has no carriage.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._simulation = plant_of(options.scenario, dict(options.set))
        self._scenario = self._simulation.scenario
        if not self._scenario.carriages:
            raise UnusableError(f"scenario: given {self._scenario.name}; allowed: one with a carriage")
        self._sensors = Sensors(self._scenario, self._simulation.snapshot.layout)
        self._carriage = next(iter(self._scenario.carriages))
        self._length = self._scenario.cable.unstrained_length
        self._server = Server()
        self._nodes: dict[str, ua.NodeId] = {}
        self._way, self._commanded, self._goes = 1.0, math.nan, STAY

    async def run(self) -> None:
        """Serve until cancelled.

        Raises:
            UnusableError: there can be no server at the URL.
        """
        await self._listen()
        url = self._options.url
        try:
            await self._server.start()
        except (OSError, ValueError) as error:
            reason = (getattr(error, "strerror", None) or str(error)).rpartition(": ")[2]
            allowed = "opc.tcp://HOST:PORT with a free port"
            raise UnusableError(f"--url: given {url}: {reason}; allowed: {allowed}") from None
        try:
            print(f"plant: {self._scenario.name} at {url}, {len(self._nodes)} variables", flush=True)
            started = time.time() - self._simulation.time
            while True:
                snapshot = self._simulation.advance_to(self._simulation.time + FRAME)
                await self._drive(started)
                for measurement in self._sensors.take(snapshot):
                    await self._write(measurement, started)
                await asyncio.sleep(max(started + snapshot.time - time.time(), 0.0))
        finally:
            await self._server.stop()

    async def _listen(self) -> None:
        await self._server.init()
        self._server.set_endpoint(self._options.url)
        self._server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        index = await self._server.register_namespace("urn:cable_twin:plant")
        names = [f"{one.of}.{name}" for one in self._scenario.sensors.values() for name, *_ in QUANTITIES[one.kind]]
        for name in dict.fromkeys([*names, f"{self._carriage}.speed_command"]):
            node_id = ua.NodeId.from_string(f"ns={index};s={name}")
            node = await self._server.nodes.objects.add_variable(node_id, f"{index}:{name}", 0.0)
            self._nodes[name] = node.nodeid

    async def _drive(self, started: float) -> None:
        """Turn round at the ends, after a stay, and tell the commanded speed."""
        place = self._simulation.snapshot.carriages[self._carriage].arc_length
        low, high = (share * self._length for share in ENDS)
        way = 1.0 if place < low else -1.0 if place > high else self._way
        if way != self._way:
            self._way, self._goes = way, self._simulation.time + STAY
        left = (high - place) if self._way > 0.0 else (place - low)
        wanted = self._way * self._options.speed * (1.0 if left > BRAKING else 0.3)
        if self._simulation.time < self._goes:
            wanted = 0.0
        if wanted != self._commanded:
            self._simulation.command(self._carriage, speed=wanted)
            self._commanded = wanted
        await self._put(f"{self._carriage}.speed_command", wanted, started + self._simulation.time)

    async def _write(self, measurement: Measurement, started: float) -> None:
        """Write the variables of a measurement with its time, by the clock of the plant."""
        sensor = self._scenario.sensors[measurement.sensor]
        for name, row, factor in QUANTITIES[sensor.kind]:
            await self._put(f"{sensor.of}.{name}", factor * measurement.values[row], started + measurement.time)

    async def _put(self, name: str, value: float, seconds: float) -> None:
        wrong = timedelta(seconds=self._options.clock)
        stamps: Any = {
            "SourceTimestamp": datetime.fromtimestamp(seconds, timezone.utc) + wrong,
            "ServerTimestamp": datetime.now(timezone.utc) + wrong,
        }
        written = ua.DataValue(ua.Variant(value, ua.VariantType.Double), **stamps)
        await self._server.write_attribute_value(self._nodes[name], written)


def main() -> int:
    """Run the plant until Ctrl-C; returns 0, or 2 for a wrong scenario or URL."""
    arguments = OneLineParser("opcua_plant", "Run a plant that speaks OPC UA.", "", failure=2)
    arguments.add_argument("scenario", nargs="?", default="aerial_tramway", help="name or path; default: %(default)s")
    arguments.add_argument("--url", default="opc.tcp://127.0.0.1:4840", help="endpoint; default: %(default)s")
    arguments.add_argument("--clock", type=float, default=0.0, metavar="S", help="s by which its stamps are wrong")
    arguments.add_argument("--speed", type=float, default=5.0, metavar="M/S", help="of its trips; default: 5")
    add_changes(arguments)
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    console = Console(stderr=True)
    try:
        options = arguments.parse_args()
        with left_at_once("opcua_plant"), compilation_shown(console, partial(print, file=sys.stderr, flush=True)):
            plant = Plant(options)
        asyncio.run(plant.run())
    except (ScenarioError, UnusableError) as error:
        tell("opcua_plant", error)
        return 2
    except KeyboardInterrupt:
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(main())
