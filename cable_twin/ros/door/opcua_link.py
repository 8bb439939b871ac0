"""Client of an OPC UA server: variables of a map as samples, with quality, stamps and the offset of its clock."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Mapping
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from asyncua import Client, ua
from asyncua.crypto import security_policies

from cable_twin.messages import SECOND
from cable_twin.ros.door.certificates import certificate_in, key_in
from cable_twin.ros.door.clocks import OneWay, RoundTrips
from cable_twin.ros.door.link import Link, Take
from cable_twin.ros.door.plant_map import OpcUa, Tag
from cable_twin.ros.door.samples import Sample, Tell

logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)  # what matters is said in lines of our own
logging.getLogger("asyncua.crypto").setLevel(logging.CRITICAL + 1)

APPLICATION = "urn:cable_twin:plant_door"
CURRENT_TIME = f"i={ua.ObjectIds.Server_ServerStatus_CurrentTime}"
ASKED_EVERY = 1.0  # s between questions that tell whether the server is there
COMPARED_EVERY = 20.0  # s between comparisons of clocks
COMPARING, PAUSE, ANSWERS = 1.5, 0.01, 4  # s of a comparison at most, s between its questions, answers that are enough
SOUGHT_EVERY = 30.0  # s between searches for nodes that were not there
KEPT_ALIVE, LIFETIME, SILENT = 2.0, 20, 5.0  # s; times that long until the server ends it; until it counts as ended
QUEUE = 4.0  # publishing intervals of which the server keeps samples
CLOSING = 2.0  # s for a farewell
EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
CREDENTIALS = {
    "BadUserAccessDenied": "user name or password refused",
    "BadIdentityTokenRejected": "user name or password refused",
    "BadIdentityTokenInvalid": "user name or password refused, or not in the form it wants",
    "BadSecurityChecksFailed": "certificate or security refused",
    "BadCertificateUntrusted": "the door's certificate is not trusted there",
    "BadCertificateInvalid": "the door's certificate is not valid there",
    "BadCertificateUriInvalid": "the door's certificate has no application URI",
    "BadSecurityModeInsufficient": "it needs more security: sign or sign_and_encrypt",
    "BadSecurityPolicyRejected": "it has no policy Basic256Sha256, or not in this mode",
}
FAILURES = (OSError, asyncio.TimeoutError, ua.UaError, ValueError, RuntimeError, EOFError)


class OpcUaLink(Link):
    """Connection to an OPC UA server.

    Args:
        name: name of the server in the map.
        section: section of the map about the server.
        tags: tags of this server, by name.
        directory: directory of the map.
        take: takes samples, from any thread.
        tell: takes lines, from any thread.
    """

    def __init__(
        self, name: str, section: OpcUa, tags: Mapping[str, Tag], directory: Path, take: Take, tell: Tell
    ) -> None:
        super().__init__(name, section, directory, take, tell)
        self._section, self._tags = section, dict(tags)
        self._names = [*tags]
        self._ended = ""  # why the server has ended the subscription
        self._trips, self._delay = RoundTrips(), OneWay()
        self._seen: set[str] = set()  # tags of this connection that had a sample

    async def run(self) -> None:
        """Connect to the server, and again whenever the connection is lost, until cancelled."""
        while True:
            client = Client(self._section.url, timeout=self._section.timeout)
            client.name = client.description = "cable_twin plant_door"
            client.application_uri = APPLICATION
            try:
                await self._connect(client)
                await self._follow(client)
            except FAILURES as error:
                self.lost(reason_of(error, self._section))
            finally:
                with suppress(*FAILURES):
                    await asyncio.wait_for(client.disconnect(), CLOSING)
            await asyncio.sleep(self.wait())

    async def _connect(self, client: Client) -> None:
        """Connect to the server with the security and the user of the map."""
        section = self._section
        user, password = self.secret(section.user), self.secret(section.password)
        if user is not None and password is not None:
            client.set_user(user)
            client.set_password(password)
        if section.security != "none":
            certificate, key = self.file(section.certificate), self.file(section.private_key)
            assert certificate is not None
            assert key is not None
            own, uri = certificate_in(certificate)
            client.application_uri = uri or APPLICATION
            pinned = self.file(section.server_certificate)
            await client.set_security(
                security_policies.SecurityPolicyBasic256Sha256,
                certificate=own,
                private_key=key_in(key, self.secret(section.private_key_password)),
                server_certificate=None if pinned is None else certificate_in(pinned)[0],
                mode=ua.MessageSecurityMode.Sign
                if section.security == "sign"
                else ua.MessageSecurityMode.SignAndEncrypt,
            )
        await asyncio.wait_for(client.connect(), 4.0 * section.timeout)

    async def _follow(self, client: Client) -> None:
        """Subscribe to all tags, and ask for the server's time until it does not answer."""
        self._seen.clear()
        await self._compare_clocks(client)
        self._ended, self.begun_ns = "", time.time_ns()
        subscription = await client.create_subscription(self._parameters(), self)
        missing = await self._subscribe(client, subscription, self._names)
        there = len(self._names) - len(missing)
        self.made(f"{there} of {len(self._names)} tags")
        sought = compared = time.monotonic()
        while True:
            await asyncio.sleep(ASKED_EVERY)
            await self._time(client)
            if self._ended or subscription.is_stale(SILENT):
                raise ValueError(f"the server has ended the subscription ({self._ended or 'silence'})")
            if time.monotonic() - compared > COMPARED_EVERY:
                await self._compare_clocks(client)
                compared = time.monotonic()
            if missing and time.monotonic() - sought > SOUGHT_EVERY:
                missing = await self._subscribe(client, subscription, missing)
                sought = time.monotonic()

    def _parameters(self) -> ua.CreateSubscriptionParameters:
        """Parameters of the OPC UA subscription, with keep-alive messages every `KEPT_ALIVE` seconds."""
        found: Any = ua.CreateSubscriptionParameters()
        found.RequestedPublishingInterval = 1e3 * self._section.interval
        found.RequestedMaxKeepAliveCount = max(math.ceil(KEPT_ALIVE / self._section.interval), 1)
        found.RequestedLifetimeCount = LIFETIME * found.RequestedMaxKeepAliveCount
        found.MaxNotificationsPerPublish = 0  # no limit
        found.PublishingEnabled = True
        return found  # type: ignore[no-any-return]

    async def _compare_clocks(self, client: Client) -> None:
        """Ask the server for its time until the offset of its clock is known."""
        self._trips.begin()
        until, counted = time.monotonic() + COMPARING, 0
        while counted < ANSWERS and time.monotonic() < until:
            sent, started = time.time_ns(), time.monotonic_ns()
            theirs = await self._time(client)
            counted += self._trips.add(sent, theirs, sent + time.monotonic_ns() - started)
            await asyncio.sleep(PAUSE)
        if self._trips.best is not None:
            self.server_clock.update(*self._trips.best)

    async def _time(self, client: Client) -> int:
        """Ask the server for its time, ns since 1970; raises an error where it does not answer."""
        theirs = await asyncio.wait_for(client.get_node(CURRENT_TIME).read_value(), self._section.timeout)
        if not isinstance(theirs, datetime):
            raise ValueError(f"time of the server: given {theirs!r:.60}; allowed: a date and time")
        return nanoseconds_of(theirs)

    async def _subscribe(self, client: Client, subscription: Any, names: list[str]) -> list[str]:
        """Subscribe to tags; returns the names of those whose nodes the server does not have, each logged once."""
        requests, asked, missing = [], [], []
        for name in names:
            try:
                node = await self._node(client, self._tags[name].address)
            except (ua.UaError, ValueError) as error:
                missing.append(self._not_there(name, reason_of(error, self._section)))
                continue
            asked.append(name)
            requests.append(self._request(node, name))
        results = await subscription.create_monitored_items(requests) if requests else []
        again = [row for row, one in enumerate(results) if isinstance(one, ua.StatusCode) and "Filter" in one.name]
        for row in again:  # a server without filters tells changes of values only
            requests[row].RequestedParameters.Filter = None
            (results[row],) = await subscription.create_monitored_items([requests[row]])
        for name, one in zip(asked, results, strict=True):
            if isinstance(one, ua.StatusCode):
                missing.append(self._not_there(name, one.name))
            elif self.refused.pop(name, ""):
                self.tell("info", f"tags.{name}: {self._tags[name].address} is there now")
        return missing

    def _not_there(self, name: str, why: str) -> str:
        if self.refused.get(name) != why:
            self.refused[name] = why
            address = self._tags[name].address
            self.tell("warning", f"tags.{name}: {self.name} has no node {address} ({why}); left out until it has")
        return name

    async def _node(self, client: Client, address: str) -> Any:
        """OPC UA node of an address, whose namespace may be given by its URI."""
        if address.startswith("nsu="):
            uri, _, own = address.removeprefix("nsu=").partition(";")
            address = f"ns={await client.get_namespace_index(uri)};{own}"
        return ua.NodeId.from_string(address)

    def _request(self, node: ua.NodeId, name: str) -> ua.MonitoredItemCreateRequest:
        tag = self._tags[name]
        asked = ua.MonitoringParameters()
        asked.ClientHandle = self._names.index(name) + 1
        asked.SamplingInterval = 1e3 / tag.rate
        asked.QueueSize = max(math.ceil(QUEUE * self._section.interval * tag.rate), 2)
        asked.DiscardOldest = True
        asked.Filter = ua.DataChangeFilter(
            Trigger=ua.DataChangeTrigger.StatusValueTimestamp, DeadbandType=0, DeadbandValue=0.0
        )
        request = ua.MonitoredItemCreateRequest()
        request.ItemToMonitor = _item(node)
        request.MonitoringMode = ua.MonitoringMode.Reporting
        request.RequestedParameters = asked
        return request

    def datachange_notification(self, _node: Any, value: Any, data: Any) -> None:
        """Pass on a new value of a tag as a sample; callback of asyncua."""
        receipt_ns = time.time_ns()
        item = data.monitored_item
        name = self._names[item.ClientHandle - 1]
        status = item.Value.StatusCode
        quality = "good" if status is None or status.is_good() else "uncertain" if status.is_uncertain() else "bad"
        stamp_ns = self._stamp(name, item.Value, receipt_ns)
        detail = "" if quality == "good" else status.name
        self.take([Sample(name, value, quality, detail, stamp_ns, receipt_ns)])  # type: ignore[arg-type]

    def status_change_notification(self, status: Any) -> None:
        """Store the reason why the server has ended the subscription; callback of asyncua."""
        self._ended = getattr(getattr(status, "Status", status), "name", "") or "without a reason"

    def _stamp(self, name: str, value: ua.DataValue, receipt_ns: int) -> int:
        """Time (ns) of a sample by our clock; the time of its receipt for an old first sample of a connection.

        The first sample after a connection is the present value, whenever it changed.
        """
        source, server = (
            None if stamp is None else nanoseconds_of(stamp) for stamp in (value.SourceTimestamp, value.ServerTimestamp)
        )
        is_first = name not in self._seen
        self._seen.add(name)
        kind = self._section.stamp
        if kind == "receipt" or (source is None and server is None):
            return receipt_ns
        if kind == "source" and source is not None:
            if not is_first:
                by_server = receipt_ns + self.server_clock.offset_ns
                self._delay.add(source, by_server)
                if self._delay.best is not None:
                    self.source_clock.update(self._delay.best)
            stamp_ns = source - self.server_clock.shift_ns - self.source_clock.shift_ns
        else:
            stamp_ns = (source if server is None else server) - self.server_clock.shift_ns  # type: ignore[operator]
        old = receipt_ns - stamp_ns > self._tags[name].stale_after * SECOND
        return receipt_ns if is_first and old else stamp_ns


def _item(node: ua.NodeId) -> ua.ReadValueId:
    item = ua.ReadValueId()
    item.NodeId = node
    item.AttributeId = ua.AttributeIds.Value
    return item


def nanoseconds_of(time_: datetime) -> int:
    """Convert a time of OPC UA, which is UTC, to ns since 1970."""
    aware = time_ if time_.tzinfo is not None else time_.replace(tzinfo=timezone.utc)
    passed = aware - EPOCH
    return (passed.days * 86400 + passed.seconds) * SECOND + passed.microseconds * 1000


def reason_of(error: BaseException, section: OpcUa) -> str:
    """Reason of a failed OPC UA connection, in words."""
    name = type(error).__name__
    if name in CREDENTIALS:
        return f"{CREDENTIALS[name]} ({name})"
    if isinstance(error, ua.UaStatusCodeError):
        return name
    if isinstance(error, asyncio.TimeoutError | TimeoutError):
        return f"no answer within {section.timeout:g} s"
    if isinstance(error, ConnectionRefusedError):
        return f"nothing listens at {section.url}"
    if isinstance(error, ConnectionError | asyncio.IncompleteReadError):
        return f"{section.url} has ended the connection"
    text = getattr(error, "strerror", None) or " ".join(str(error).split())
    return text or name
