"""OPC UA server of `plant_door`: estimates and alarms of a twin as variables, whose status code reflects their age."""

from __future__ import annotations

import asyncio
import hmac
import logging
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from asyncua import Server as UaServer
from asyncua import ua
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.user_managers import UserManager

from cable_twin.basics.newest import NewestLines
from cable_twin.basics.printable import printable
from cable_twin.messages import SECOND, Status
from cable_twin.messages.figure_messages import OF_PAYLOAD
from cable_twin.ros.door.certificates import certificate_in, key_in
from cable_twin.ros.door.link import FIRST_WAIT, secrets_of, without
from cable_twin.ros.door.map_file import secret_text
from cable_twin.ros.door.plant_map import Server
from cable_twin.ros.door.samples import Level, Tell

logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)

URI = "urn:cable_twin:estimates"
ALARMS = 20  # newest ones that are kept, those about payloads the first to go
LOST = 12.0  # times `stale_after`, after which values are not uncertain but bad
MOST = 10_000  # variables of estimates
LONGEST_WAIT = 30.0  # s between two attempts to listen
WARNING = 1  # level of a status
POLICIES = {
    "none": ua.SecurityPolicyType.NoSecurity,
    "sign": ua.SecurityPolicyType.Basic256Sha256_Sign,
    "sign_and_encrypt": ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
}
GOOD, WAITING = ua.StatusCodes.Good, ua.StatusCodes.BadWaitingForInitialData
OLD, GONE = ua.StatusCodes.UncertainLastUsableValue, ua.StatusCodes.BadNoCommunication
UNMEASURED = ua.StatusCodes.UncertainSubNormal  # of the model alone, while the plant is silent


class _Users(UserManager):
    """Check of user name and password of OPC UA clients; if none are configured, every client may read."""

    def __init__(self, user: str | None, password: str | None) -> None:
        self._given = None if user is None or password is None else (user.encode(), password.encode())

    def get_user(
        self, _server: Any, username: Any = None, password: Any = None, certificate: Any = None
    ) -> User | None:
        """User of an OPC UA session; None for a refused one."""
        if self._given is None:
            return User(role=UserRole.User)
        given = [text.encode() if isinstance(text, str) else bytes(text or b"") for text in (username, password)]
        equal = [hmac.compare_digest(one, wanted) for one, wanted in zip(given, self._given, strict=True)]
        return User(role=UserRole.User) if all(equal) else None


class EstimateServer:
    """OPC UA server with the folders Estimates, Alarms and Status below an object `cable_twin`.

    Args:
        section: section of the map about the server.
        directory: directory of the map.
        tell: takes lines, from any thread.

    Attributes:
        listens: whether clients can connect.
    """

    def __init__(self, section: Server, directory: Path, tell: Tell) -> None:
        self._section, self._directory = section, directory
        self._to, self._secrets = tell, [*secrets_of(section, directory)]
        self.listens = False
        self._server: UaServer | None = None
        self._index = 2
        self._folders: dict[str, Any] = {}
        self._values: dict[str, tuple[ua.NodeId, ua.Variant, int]] = {}  # by name: node, value, stamp (ns)
        self._made: set[str] = set()
        self._updates: asyncio.Queue[tuple[str, list[Status], int]] = asyncio.Queue()
        self._alarms = NewestLines(ALARMS)
        self._count = 0
        self._heard: float | None = None  # monotonic time (s) of the newest estimate
        self._status = self._fresh = WAITING  # now, and of the newest estimates when they came

    def tell(self, level: Level, text: str) -> None:
        """Log a line, with all secrets replaced."""
        self._to(level, without(self._secrets, printable(text, 500)))

    def update(self, topic: str, statuses: list[Status], stamp_ns: int) -> None:
        """Queue a message of the twin for its variables; called in the event loop of the server."""
        self._updates.put_nowait((topic, statuses, stamp_ns))

    async def run(self) -> None:
        """Serve OPC UA clients until cancelled; an address that cannot be opened is tried again."""
        wait, told = FIRST_WAIT, ""
        while True:
            try:
                await self._listen()
                break
            except (OSError, ua.UaError, ValueError) as error:
                reason = getattr(error, "strerror", None) or str(error)
                if reason != told:
                    told = reason
                    self.tell("warning", f"server: {self._section.url} cannot be opened: {reason}; trying again")
                await asyncio.sleep(wait)
                wait = min(2.0 * wait, LONGEST_WAIT)
        self.listens = True
        self.tell("info", f"server: {self._section.url} has the estimates and alarms of {self._section.twin}")
        try:
            while True:
                with suppress(asyncio.TimeoutError):
                    update = await asyncio.wait_for(self._updates.get(), min(self._section.stale_after / 4.0, 1.0))
                    await self._write(*update)
                await self._check_age()
        finally:
            self.listens = False
            await self._server.stop()  # type: ignore[union-attr]

    async def _listen(self) -> None:
        section = self._section

        def secret(key: str) -> str | None:
            given = getattr(section, key)
            return None if given is None else secret_text(given, self._directory)

        server = UaServer(user_manager=_Users(secret("user"), secret("password")))  # type: ignore[arg-type]
        await server.init()
        server.set_endpoint(section.url)
        server.set_server_name("cable_twin plant_door")
        server.set_security_policy([POLICIES[section.security]])
        server.allow_remote_admin(False)
        server.set_identity_tokens([ua.AnonymousIdentityToken] if section.user is None else [ua.UserNameIdentityToken])
        if section.certificate is not None and section.private_key is not None:
            own, uri = certificate_in((self._directory / section.certificate).expanduser())
            if uri:
                await server.set_application_uri(uri)
            await server.load_certificate(own.path_or_content, own.extension)
            key = key_in((self._directory / section.private_key).expanduser(), secret("private_key_password"))
            await server.load_private_key(key.path_or_content, key.password, key.extension)
        self._index = await server.register_namespace(URI)
        root = await server.nodes.objects.add_object(self._id("cable_twin"), self._name("cable_twin"))
        for name in ("Estimates", "Alarms", "Status"):
            self._folders[name] = await root.add_folder(self._id(name), self._name(name))
        self._server = server
        self._made.clear()
        await self._variable("Status", "Age", ua.Variant(math.nan, ua.VariantType.Double), unit="s")
        texts = ua.Variant([], ua.VariantType.String, is_array=True)
        await self._variable("Alarms", "Newest", ua.Variant("", ua.VariantType.String))
        await self._variable("Alarms", "List", texts)
        await self._variable("Alarms", "Count", ua.Variant(0, ua.VariantType.UInt32))
        await self._variable("Alarms", "Active", ua.Variant(False, ua.VariantType.Boolean))
        await server.start()

    def _id(self, name: str) -> ua.NodeId:
        return ua.NodeId.from_string(f"ns={self._index};s={name}")

    def _name(self, name: str) -> ua.QualifiedName:
        return ua.QualifiedName(name, self._index)

    async def _variable(self, folder: str, name: str, value: ua.Variant, *, unit: str = "") -> None:
        """Make an OPC UA variable that only this server writes."""
        key = f"{folder}/{name}"
        node = await self._folders[folder].add_variable(self._id(key), self._name(name), value)
        if unit:
            known = ua.EUInformation(
                NamespaceUri="http://www.opcfoundation.org/UA/units/un/cefact",
                UnitId=-1,
                DisplayName=ua.LocalizedText(unit),
                Description=ua.LocalizedText(unit),
            )
            await node.add_property(self._id(f"{key}/EngineeringUnits"), ua.QualifiedName("EngineeringUnits", 0), known)
        self._made.add(key)
        self._values[key] = node.nodeid, value, 0
        await self._put(key, value, 0, WAITING)

    async def _put(self, key: str, value: ua.Variant, stamp_ns: int, status: int) -> None:
        """Write an OPC UA variable with its status, and with the stamp (ns) of the twin as source timestamp."""
        assert self._server is not None
        node = self._values[key][0]
        self._values[key] = node, value, stamp_ns
        stamp = datetime.fromtimestamp(stamp_ns / SECOND, timezone.utc) if stamp_ns else None
        written: Any = {"SourceTimestamp": stamp, "ServerTimestamp": datetime.now(timezone.utc)}
        code = ua.StatusCode(status)  # type: ignore[arg-type]
        await self._server.write_attribute_value(node, ua.DataValue(value, code, **written))

    async def _write(self, topic: str, statuses: Sequence[Status], stamp_ns: int) -> None:
        """Write the estimates and alarms, or the statuses, of a twin's message to their variables."""
        if topic == "estimate":
            self._heard = time.monotonic()
            self._status = self._fresh = self._quality(statuses)
            for status in statuses:
                if "value" in status.values:
                    await self._estimate(status, stamp_ns)
            new = {key: text for one in statuses for key, text in one.values.items() if key.startswith("alarm_")}
            await self._alarm(new, any(status.level >= WARNING for status in statuses), stamp_ns)
        else:
            for status in statuses:
                name = printable(status.name, 80)
                for key, value in (
                    ("Level", ua.Variant(int(status.level), ua.VariantType.Byte)),
                    ("Message", _text(status.message)),
                ):
                    await self._set("Status", f"{name}/{key}", value, stamp_ns)

    def _quality(self, statuses: Sequence[Status]) -> int:
        """Status code of new estimates: of those of the model alone, or far behind the plant, uncertain."""
        told = next((one.values for one in statuses if "measured" in one.values), {})
        if told.get("measured", "true") != "true":
            return UNMEASURED
        return OLD if _number(told.get("behind_s", "0")) > self._section.stale_after else GOOD

    async def _estimate(self, status: Status, stamp_ns: int) -> None:
        name, unit = printable(status.name, 80), printable(status.values.get("unit", ""), 20)
        for key, at in (("value", name), ("standard_deviation", f"{name}/StandardDeviation")):
            value = _number(status.values.get(key, ""))
            code = self._fresh if math.isfinite(value) else ua.StatusCodes.BadNoData
            await self._set("Estimates", at, ua.Variant(value, ua.VariantType.Double), stamp_ns, code, unit)

    async def _alarm(self, new: Mapping[str, str], active: bool, stamp_ns: int) -> None:
        """Write new alarms, by their keys in the twin's message, of which those about payloads go first."""
        for minor in (False, True):
            own = [printable(text, 300) for key, text in new.items() if key.endswith(OF_PAYLOAD) == minor]
            self._alarms.add(own, minor=minor)
        self._count += len(new)
        await self._set("Alarms", "Active", ua.Variant(active, ua.VariantType.Boolean), stamp_ns)
        await self._set("Alarms", "Count", ua.Variant(self._count, ua.VariantType.UInt32), stamp_ns)
        if new or self._values["Alarms/List"][2] == 0:
            lines = self._alarms.lines
            texts = ua.Variant(lines, ua.VariantType.String, is_array=True)
            await self._set("Alarms", "List", texts, stamp_ns)
            await self._set("Alarms", "Newest", _text(lines[-1] if lines else ""), stamp_ns)

    async def _set(
        self, folder: str, name: str, value: ua.Variant, stamp_ns: int, status: int = GOOD, unit: str = ""
    ) -> None:
        """Write an OPC UA variable, which is made at its first value."""
        key = f"{folder}/{name}"
        if key not in self._made:
            if len(self._made) >= MOST:
                return
            await self._variable(folder, name, value, unit=unit)
        await self._put(key, value, stamp_ns, status)

    async def _check_age(self) -> None:
        """Write the age of the estimates, and give old estimates and alarms the status uncertain or bad."""
        if self._heard is None:
            return
        age = time.monotonic() - self._heard
        await self._put("Status/Age", ua.Variant(age, ua.VariantType.Double), time.time_ns(), GOOD)
        stale = self._section.stale_after
        status = self._fresh if age <= stale else OLD if age <= LOST * stale else GONE
        if status == self._status:
            return
        if status == OLD and age > stale:
            text = f"server: no estimate of {self._section.twin} for {stale:g} s; its values are uncertain"
            self.tell("warning", text)
        self._status = status
        for key, (_, value, stamp_ns) in [*self._values.items()]:
            if key.startswith(("Estimates/", "Alarms/")):
                await self._put(key, value, stamp_ns, status)


def _text(text: str) -> ua.Variant:
    return ua.Variant(printable(text, 500), ua.VariantType.String)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
