"""Servers of a plant for tests: OPC UA and MQTT on free ports of this machine, to be killed and started again."""

from __future__ import annotations

import asyncio
import atexit
import json
import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from datetime import datetime, timedelta, timezone
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from twin_process import PATIENCE, wait_until

BROKER = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")
USER, PASSWORD = "operator", "Correct-horse_9"


def free_port() -> int:
    """Port of this machine that nobody listens on."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def listens(port: int) -> bool:
    """Whether somebody listens on a port of this machine."""
    with socket.socket() as one:
        one.settimeout(1.0)
        return one.connect_ex(("127.0.0.1", port)) == 0


class _Process:
    """Process of a server on a port, which it has again after it was killed."""

    def __init__(self, directory: Path) -> None:
        self.directory, self.port, self.pid = directory, free_port(), 0

    def launch(self) -> int:
        raise NotImplementedError

    def start(self) -> None:
        """Start, and wait until it listens."""
        self.pid = self.launch()
        try:
            wait_until(lambda: listens(self.port), what=f"port {self.port}")
        except AssertionError:
            self.kill()
            raise

    def kill(self) -> None:
        """Kill it as `kill -9` does."""
        if self.pid:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
            wait_until(lambda: not listens(self.port), what=f"end of port {self.port}")
        self.pid = 0


class OpcUa(_Process):
    """OPC UA server of asyncua whose variables tests set.

    Args:
        directory: of files.
        values: by name at its start; variables are ns=2;s=NAME.
        clock: s that its clock is wrong by.
        security: certificate and private key; only encrypted sessions of `USER` are accepted then.
    """

    def __init__(
        self, directory: Path, values: dict[str, Any], *, clock: float = 0.0, security: tuple[Path, Path] | None = None
    ) -> None:
        super().__init__(directory)
        self._given = {
            "url": self.url,
            "values": values,
            "clock": clock,
            "security": [str(file) for file in security or ()],
            "port": self.port,
        }

    @property
    def url(self) -> str:
        return f"opc.tcp://127.0.0.1:{self.port}"

    def launch(self) -> int:
        """Fork one from the process in which the address space is made already, which takes seconds."""
        server = _fork_server()
        assert server.stdin is not None
        assert server.stdout is not None
        server.stdin.write(json.dumps(self._given) + "\n")
        server.stdin.flush()
        return int(server.stdout.readline())

    def set(self, name: str, value: Any, status: str = "Good", age: float = 0.0) -> None:
        """Write a variable, measured s ago by the clock of the server."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
            one.sendto(json.dumps([name, value, status, age]).encode(), ("127.0.0.1", self.port))


class Mosquitto(_Process):
    """MQTT broker of Debian's package mosquitto.

    Args:
        directory: for its configuration.
        lines: of that, more than those of a listener for everybody.
    """

    def __init__(self, directory: Path, *lines: str) -> None:
        super().__init__(directory)
        if BROKER is None:
            pytest.skip("mosquitto is not installed: apt-get install mosquitto")
        allow = "false" if lines else "true"
        user = ["user root"] if os.geteuid() == 0 else []  # who can read the directories of tests
        text = [f"listener {self.port} 127.0.0.1", f"allow_anonymous {allow}", "persistence false", *user, *lines]
        (directory / f"mosquitto_{self.port}.conf").write_text("\n".join(text) + "\n")
        self._process: subprocess.Popen[bytes] | None = None

    def launch(self) -> int:
        """Start it with its own configuration."""
        assert BROKER is not None
        with (self.directory / f"mosquitto_{self.port}.txt").open("ab") as output:
            file = self.directory / f"mosquitto_{self.port}.conf"
            self._process = subprocess.Popen([BROKER, "-c", str(file)], stdout=output, stderr=subprocess.STDOUT)
        return self._process.pid

    def kill(self) -> None:
        """Kill it, and take its exit code."""
        super().kill()
        if self._process is not None:
            self._process.wait()

    def publish(self, topic: str, payload: object, *, retain: bool = False) -> None:
        """Publish one message."""
        from paho.mqtt import publish  # noqa: PLC0415 - an extra

        text = payload if isinstance(payload, str) else json.dumps(payload)
        publish.single(topic, text, qos=1, retain=retain, hostname="127.0.0.1", port=self.port)


@cache
def _fork_server() -> subprocess.Popen[str]:
    """Process that forks OPC UA servers, and ends with its input."""
    server = subprocess.Popen([sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(server.communicate)
    return server


class OpcUaReader:
    """Client of an OPC UA server in a thread, for values with their status."""

    def __init__(self, url: str, security: str = "", password: str = "") -> None:
        from asyncua import Client  # noqa: PLC0415 - an extra

        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        self.client = Client(url)
        if security:
            self.client.set_user(USER)
            self.client.set_password(password)
            self.call(self.client.set_security_string(security))
        self.call(self.client.connect())

    def call(self, coroutine: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(PATIENCE)

    def read(self, name: str) -> Any:
        """Value with status and stamps of ns=2;s=NAME; None where there is none."""
        from asyncua import ua  # noqa: PLC0415 - an extra

        try:
            return self.call(self.client.get_node(f"ns=2;s={name}").read_data_value(raise_on_bad_status=False))
        except ua.UaError:
            return None

    def close(self) -> None:
        with suppress(Exception):
            self.call(self.client.disconnect())
        self._loop.call_soon_threadsafe(self._loop.stop)


def make_certificate(directory: Path, name: str) -> tuple[Path, Path]:
    """Self-signed certificate and its key, for OPC UA and TLS on 127.0.0.1."""
    from ipaddress import ip_address  # noqa: PLC0415

    from asyncua.crypto import cert_gen  # noqa: PLC0415 - an extra
    from cryptography import x509  # noqa: PLC0415
    from cryptography.hazmat.primitives.serialization import Encoding  # noqa: PLC0415
    from cryptography.x509.oid import ExtendedKeyUsageOID  # noqa: PLC0415

    key = cert_gen.generate_private_key()
    names = [
        x509.UniformResourceIdentifier(f"urn:test:{name}"),
        x509.DNSName("localhost"),
        x509.IPAddress(ip_address("127.0.0.1")),
    ]
    usage = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    certificate = cert_gen.generate_self_signed_app_certificate(key, name, {}, names, usage)
    files = directory / f"{name}.pem", directory / f"{name}_key.pem"
    files[0].write_bytes(certificate.public_bytes(Encoding.PEM))
    files[1].write_bytes(cert_gen.dump_private_key_as_pem(key))
    return files


class _Users:
    """User manager of a secure server."""

    def get_user(self, _server, username=None, password=None, certificate=None):
        from asyncua.crypto.permission_rules import User, UserRole  # noqa: PLC0415 - an extra

        return User(role=UserRole.User) if (username, password) == (USER, PASSWORD) else None


async def prepared() -> Any:
    """OPC UA server with the standard address space."""
    from asyncua import Server  # noqa: PLC0415 - an extra

    server = Server()
    await server.init()
    return server


async def serve(server: Any, given: dict[str, Any]) -> None:
    """Write what datagrams on a UDP port say, until killed."""
    from asyncua import ua  # noqa: PLC0415 - an extra

    server.set_endpoint(given["url"])
    policy = ua.SecurityPolicyType.NoSecurity
    if given["security"]:
        policy = ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt
        certificate, key = given["security"]
        server.iserver.user_manager = _Users()
        await server.set_application_uri("urn:test:server")
        await server.load_certificate(certificate, "pem")
        await server.load_private_key(key, format="pem")
        server.set_identity_tokens([ua.UserNameIdentityToken])
    server.set_security_policy([policy])
    index = await server.register_namespace("urn:test")
    wrong = timedelta(seconds=given["clock"])
    nodes = {}
    for name, value in given["values"].items():
        node = await server.nodes.objects.add_variable(ua.NodeId.from_string(f"ns={index};s={name}"), name, value)
        nodes[name] = node.nodeid
    if wrong:
        server.disable_clock()
        clock = server.get_node(ua.NodeId(ua.ObjectIds.Server_ServerStatus_CurrentTime))
        server.set_attribute_value_callback(
            clock.nodeid,
            lambda *_: ua.DataValue(ua.Variant(datetime.now(timezone.utc) + wrong)),
            ua.AttributeIds.Value,
        )

    async def write(name: str, value: Any, status: str, age: float) -> None:
        now = datetime.now(timezone.utc) + wrong
        kind = {float: ua.VariantType.Double, int: ua.VariantType.Int64}.get(type(value))
        stamps = {"SourceTimestamp": now - timedelta(seconds=age), "ServerTimestamp": now}
        code = ua.StatusCode(getattr(ua.StatusCodes, status))
        await server.write_attribute_value(nodes[name], ua.DataValue(ua.Variant(value, kind), code, **stamps))

    loop = asyncio.get_running_loop()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as inbox:
        inbox.bind(("127.0.0.1", given["port"]))
        inbox.setblocking(False)
        async with server:
            while True:
                if os.getppid() == 1:  # the tests have ended
                    return
                with suppress(asyncio.TimeoutError):
                    data = await asyncio.wait_for(loop.sock_recv(inbox, 65536), 1.0)
                    await write(*json.loads(data))


def fork_servers() -> None:
    """Fork a server for each line of the input, and print its process number."""
    logging.disable(logging.CRITICAL)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # those that are killed
    server = asyncio.run(prepared())
    for line in sys.stdin:
        if pid := os.fork():
            print(pid, flush=True)
            continue
        os.close(0)
        os.dup2(2, 1)
        asyncio.run(serve(server, json.loads(line)))
        os._exit(0)


if __name__ == "__main__":
    fork_servers()
