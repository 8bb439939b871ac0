"""Client of an MQTT broker: numbers and JSON messages on topics as samples."""

from __future__ import annotations

import json
import math
import ssl
import threading
import time
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode

from cable_twin.basics.printable import printable
from cable_twin.messages import SECOND
from cable_twin.ros.door.clocks import OneWay
from cable_twin.ros.door.link import Link, Take
from cable_twin.ros.door.plant_map import Mqtt, Tag
from cable_twin.ros.door.samples import Sample, Tell

TURN = 0.2  # s of one turn of the client's loop
CONNECTING = 5.0  # s in which the broker has to answer
LARGEST = 2**16  # bytes of a message
LARGE = ((1e17, 1), (1e14, 1000), (1e11, 1_000_000))  # numbers from which on a stamp is in ns, us, ms; else in s
RETAINED = "of a retained message without stamp, which may be old"
NO_SUCH_KEY = object()


class MqttLink(Link):
    """Connection to an MQTT broker, in a thread of its own.

    Args:
        name: name of the broker in the map.
        section: section of the map about the broker.
        tags: tags of this broker, by name.
        directory: directory of the map.
        take: takes samples, from any thread.
        tell: takes lines, from any thread.
    """

    def __init__(
        self, name: str, section: Mqtt, tags: Mapping[str, Tag], directory: Path, take: Take, tell: Tell
    ) -> None:
        super().__init__(name, section, directory, take, tell)
        self._section = section
        self._by_topic: dict[str, dict[str, Tag]] = {}
        for tag_name, tag in tags.items():
            self._by_topic.setdefault(tag.address, {})[tag_name] = tag
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"plant_door {name}", daemon=True)
        self._refusal = ""
        self._asked: dict[int, str] = {}  # topics by number of their subscription
        self._waiting = 0  # subscriptions without an answer
        self._delay = OneWay()

    def start(self) -> None:
        """Start the thread that connects to the broker, and again whenever the connection is lost."""
        self._thread.start()

    def stop(self) -> None:
        """Disconnect from the broker, and end the thread."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join(2.0 * CONNECTING)

    def _run(self) -> None:
        while not self._end.is_set():
            self._refusal = ""
            try:
                self._follow()
            except (OSError, ValueError, ssl.SSLError) as error:
                self.lost(self._refusal or self._reason_of(error))
            except Exception as error:  # of the program, which the main thread reports
                self.fault = error
                return
            self._end.wait(self.wait())

    def _follow(self) -> None:
        """Connect to the broker and receive messages until the connection is lost, which raises an error."""
        section = self._section
        client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id=section.client, reconnect_on_failure=False)
        client.suppress_exceptions = False
        user = self.secret(section.user)
        if user is not None:
            client.username_pw_set(user, self.secret(section.password))
        if section.tls:
            authority, certificate, key = map(self.file, (section.authority, section.certificate, section.private_key))
            client.tls_set(
                ca_certs=None if authority is None else str(authority),
                certfile=None if certificate is None else str(certificate),
                keyfile=None if key is None else str(key),
                keyfile_password=self.secret(section.private_key_password),
            )
        client.connect_timeout = CONNECTING
        client.on_connect, client.on_message, client.on_subscribe = (
            self._on_connect,
            self._on_message,
            self._on_subscribe,
        )
        client.connect(section.host, section.port, section.keep_alive)
        try:
            while not self._end.is_set():
                code = client.loop(TURN)
                if code == MQTTErrorCode.MQTT_ERR_CONN_LOST:
                    raise ConnectionError(f"{section.host}:{section.port} has ended the connection")
                if code != MQTTErrorCode.MQTT_ERR_SUCCESS:
                    raise ConnectionError(mqtt.error_string(code).rstrip("."))
        finally:
            client.disconnect()

    def _on_connect(self, client: mqtt.Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            self._refusal = f"refused: {reason}"
            return
        self._asked.clear()
        self.begun_ns = time.time_ns()
        self._waiting = len(self._by_topic)
        for topic in self._by_topic:
            _, number = client.subscribe(topic, self._section.quality_of_service)
            self._asked[number or 0] = topic
        if not self._by_topic:
            self.made("no tags")

    def _on_subscribe(self, _client: mqtt.Client, _data: Any, number: int, reasons: Any, _properties: Any) -> None:
        names = self._by_topic.get(self._asked.get(number, ""), {})
        refused = [str(reason) for reason in reasons if reason.is_failure]
        for name, tag in names.items():
            if refused and name not in self.refused:
                self.refused[name] = refused[0]
                self.tell("warning", f"tags.{name}: {self.name} refuses {tag.address} ({refused[0]}); left out")
            elif not refused and self.refused.pop(name, ""):
                self.tell("info", f"tags.{name}: {self.name} allows {tag.address} now")
        self._waiting -= 1
        if self._waiting == 0:
            count = sum(map(len, self._by_topic.values()))
            self.made(f"{count - len(self.refused)} of {count} tags")

    def _on_message(self, _client: mqtt.Client, _data: Any, message: mqtt.MQTTMessage) -> None:
        receipt_ns = time.time_ns()
        content: Any = NO_SUCH_KEY
        samples = []
        for name, tag in self._by_topic.get(message.topic, {}).items():
            if tag.field is not None and content is NO_SUCH_KEY:
                content = parsed(message.payload)
            samples.append(self._sample(name, tag, message, content, receipt_ns))
        self.take(samples)

    def _sample(self, name: str, tag: Tag, message: mqtt.MQTTMessage, content: Any, receipt_ns: int) -> Sample:
        """Sample of a tag from an MQTT message, with its quality and stamp."""
        value = number(message.payload) if tag.field is None else at(content, tag.field)
        if value is NO_SUCH_KEY:
            return Sample(name, value, "bad", f"of a message without the key {tag.field}", receipt_ns, receipt_ns)
        if tag.quality_field is not None:
            quality = at(content, tag.quality_field)
            text = (
                "missing"
                if quality is NO_SUCH_KEY
                else json.dumps(quality)
                if isinstance(quality, bool)
                else str(quality)
            )
            if text.lower() not in (word.lower() for word in tag.good):
                return Sample(name, value, "bad", printable(text, 40), receipt_ns, receipt_ns)
        if tag.stamp_field is None:
            if message.retain:
                return Sample(name, value, "uncertain", RETAINED, receipt_ns, receipt_ns)
            return Sample(name, value, "good", "", receipt_ns, receipt_ns)
        stamp_ns = stamp_of(at(content, tag.stamp_field))
        if stamp_ns is None:
            shown = f"of a message whose {tag.stamp_field} is no stamp"
            return Sample(name, value, "bad", shown, receipt_ns, receipt_ns)
        if self._section.stamp == "receipt":
            stamp_ns = receipt_ns
        else:
            if not message.retain:
                self._delay.add(stamp_ns, receipt_ns)
                if self._delay.best is not None:
                    self.source_clock.update(self._delay.best)
            stamp_ns -= self.source_clock.shift_ns
        return Sample(name, value, "good", "", stamp_ns, receipt_ns)

    def _reason_of(self, error: Exception) -> str:
        """Reason of a failed connection to the broker, in words."""
        where = f"{self._section.host}:{self._section.port}"
        if isinstance(error, ssl.SSLCertVerificationError):
            return f"TLS: {error.verify_message}"
        if isinstance(error, ssl.SSLError):
            return f"TLS: {error.reason or error}"
        if isinstance(error, ConnectionRefusedError):
            return f"nothing listens at {where}"
        if isinstance(error, TimeoutError):
            return f"no answer from {where}"
        return str(getattr(error, "strerror", None) or error or type(error).__name__)


def parsed(payload: bytes | bytearray) -> Any:
    """Content of a JSON message, `NO_SUCH_KEY` if the payload is no JSON."""
    if len(payload) > LARGEST:
        return NO_SUCH_KEY
    try:
        return json.loads(payload)
    except (ValueError, RecursionError):
        return NO_SUCH_KEY


def number(payload: bytes | bytearray) -> object:
    """Number in the payload of an MQTT message; its text if it is no number."""
    text = payload[:LARGEST].decode("utf-8", "replace").strip()
    try:
        return float(text)
    except ValueError:
        return text


def at(content: Any, path: str) -> Any:
    """Value at a dotted key of a JSON message, whose list items are given by index; `NO_SUCH_KEY` if missing."""
    for key in path.split("."):
        if isinstance(content, dict) and key in content:
            content = content[key]
        elif isinstance(content, list) and key.isdecimal() and int(key) < len(content):
            content = content[int(key)]
        else:
            return NO_SUCH_KEY
    return content


def stamp_of(value: Any) -> int | None:
    """Stamp in ns since 1970 of a text in ISO 8601 (UTC without a zone), or of a number of s, ms, us or ns."""
    if isinstance(value, str):
        try:
            stamp = datetime.fromisoformat(value.strip().replace("Z", "+00:00"))
        except ValueError:
            return None
        aware = stamp if stamp.tzinfo is not None else stamp.replace(tzinfo=timezone.utc)
        return round(aware.timestamp() * 1e6) * 1000
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value <= 0:
        return None
    factor = next((factor for least, factor in LARGE if value >= least), SECOND)
    stamp_ns = round(value * factor)
    return stamp_ns if stamp_ns < 2**62 else None
