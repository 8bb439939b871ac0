"""Connection to an OPC UA server or MQTT broker: lines about loss and return, waits between attempts, clocks."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from cable_twin.basics.printable import printable
from cable_twin.messages import SECOND
from cable_twin.ros.door.clocks import Correction
from cable_twin.ros.door.map_file import Connection, secret_text
from cable_twin.ros.door.plant_map import Mqtt, OpcUa, Secret
from cable_twin.ros.door.samples import Level, Sample, Tell

FIRST_WAIT = 0.5  # s before the second attempt
JITTER = 0.2  # share of a wait that is random, so that several doors do not come together
SHORTEST_SECRET = 3  # characters; shorter ones would be found anywhere
LONGEST_REASON = 200  # characters

Take = Callable[[list[Sample]], None]


class Link:
    """State of a connection to an OPC UA server or MQTT broker, with its log lines, retries, clocks and secrets.

    Args:
        name: name of the connection in the map.
        section: section of the map about the connection.
        directory: directory of the map.
        take: takes samples, from any thread.
        tell: takes lines, from any thread.

    Attributes:
        connected: whether samples can come.
        since_ns: time of the last change of `connected`.
        begun_ns: time of the newest connection, before which no sample comes from it.
        attempts: attempts to connect since the last success.
        losses: losses of the connection.
        fault: fault of the program that has ended the work of this connection.
        refused: why the other side gives no samples of tags, by name.
    """

    def __init__(self, name: str, section: OpcUa | Mqtt, directory: Path, take: Take, tell: Tell) -> None:
        self.name, self.section, self.directory = name, section, directory
        self.take = take
        self._tell, self._secrets = tell, [*secrets_of(section, directory)]
        self.connected, self.since_ns, self.begun_ns = False, time.time_ns(), 0
        self.attempts = self.losses = 0
        self._reason = ""
        self._made = False
        self.fault: BaseException | None = None
        self.refused: dict[str, str] = {}
        correct = section.clock == "correct"
        tolerance_ns = round(section.clock_tolerance * SECOND)
        self.server_clock = Correction(f"{name}: its clock", self.tell, correct=correct)
        self.source_clock = Correction(
            f"{name}: the clock of its sensors", self.tell, correct=correct, tolerance_ns=tolerance_ns
        )

    def stop(self) -> None:
        """Disconnect, where the connection has a thread of its own."""

    def tell(self, level: Level, text: str) -> None:
        """Log a line, with all secrets replaced."""
        self._tell(level, without(self._secrets, printable(text, 500)))

    def made(self, what: str) -> None:
        """Record and log that the connection is made, with a text about its tags."""
        now = time.time_ns()
        again = f" again after {(now - self.since_ns) / SECOND:.1f} s" if self._made else ""
        self.connected, self.since_ns, self.attempts, self._reason = True, now, 0, ""
        self._made = True
        self.tell("info", f"{self.name}: connected{again}, {what}")

    def lost(self, reason: str) -> None:
        """Record that the connection is lost or cannot be made, and log the reason if it is a new one."""
        reason = printable(reason, LONGEST_REASON)
        self.attempts += 1
        if self.connected:
            self.losses += 1
            self.connected, self.since_ns = False, time.time_ns()
            text = f"connection lost: {reason}"
        elif reason != self._reason:
            text = f"no connection: {reason}"
        else:
            return
        self._reason = reason
        self.tell("warning", f"{self.name}: {text}; nothing comes from it, trying again")

    def wait(self) -> float:
        """Time (s) to wait before the next attempt: twice as long each time."""
        longest = min(FIRST_WAIT * 2.0 ** min(max(self.attempts - 1, 0), 10), self.section.retry)
        return longest * (1.0 - JITTER * random.random())

    def secret(self, secret: Secret | None) -> str | None:
        """Read the text of a secret, such as a password, anew from its environment variable or file."""
        return None if secret is None else secret_text(secret, self.directory)

    def file(self, name: str | None) -> Path | None:
        """Path of a file in the map, relative to the map."""
        return None if name is None else (self.directory / name).expanduser()

    def values(self) -> dict[str, str]:
        """Values of the connection for the diagnostics: state, losses and clock offsets."""
        found = {"connected": str(self.connected).lower(), "connections_lost": str(self.losses)}
        if self.server_clock.uncertainty_ns is not None:
            found["clock_offset_s"] = f"{self.server_clock.offset_ns / SECOND:.6f}"
            found["clock_uncertainty_s"] = f"{self.server_clock.uncertainty_ns / SECOND:.6f}"
        found["stamps_shifted_s"] = f"{-(self.server_clock.shift_ns + self.source_clock.shift_ns) / SECOND:.6f}"
        return found

    @property
    def reason(self) -> str:
        """Reason why there is no connection."""
        return self._reason


def secrets_of(section: Connection, directory: Path) -> Iterable[str]:
    """Texts of all secrets of a connection (user name, passwords) that have to be masked in log lines."""
    for key in ("password", "private_key_password", "user"):
        secret = getattr(section, key)
        if secret is not None:
            text = secret_text(secret, directory)
            if len(text) >= SHORTEST_SECRET:
                yield text


def without(secrets: Iterable[str], text: str) -> str:
    """Text in which secrets are replaced, in case a library has put one into it."""
    for secret in secrets:
        text = text.replace(secret, "***")
    return text
