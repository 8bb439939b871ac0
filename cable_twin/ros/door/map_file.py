"""Reading of plant maps, with a line per error; an invalid tag is left out, any other error refuses the map."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from cable_twin.basics.limited_yaml import read_mapping
from cable_twin.basics.printable import printable
from cable_twin.ros.door.plant_map import OUT_OF_THE_MAP, UNIT_OF_TAG, Mqtt, OpcUa, PlantMap, Secret, Server, Tag
from cable_twin.ros.door.quantities import HINTS, POLAR, QUANTITIES, UNITS, units_of
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.scenario.checks.fault import NAME, allowed, inner_model, listed, show

LEFT_OUT = "this tag is left out"
SECRETS = ("user", "password", "private_key_password", "url")  # of which nothing is ever shown
NODE = re.compile(r"(ns=\d{1,5};|nsu=[^;]+;)?([is]=.+|g=[0-9a-fA-F-]{36}|b=.+)")
LOOPBACK = ("127.0.0.1", "localhost", "::1")
LONGEST_TOPIC, LONGEST_SECRET = 65535, 4096  # bytes, characters
END = f"({NAME}/)?(start|end)"  # of a rope, among several with the name of the rope
NAMES = {"body": f"{NAME}(/{NAME})?", "support": f"{NAME}|{END}", "place": f"{NAME}|{END}"}
OF_MQTT = ("field", "stamp_field", "quality_field")

Connection = OpcUa | Mqtt | Server


class MapError(ValueError):
    """Exception for a plant map that cannot be used; its text has one line for each error found."""


class Warned(NamedTuple):
    """Usable plant map, with lines about the tags left out of it and lines of warning about unsafe connections."""

    plan: PlantMap
    left_out: list[str]
    warnings: list[str]


def read_map(file: Path) -> Warned:
    """Read and validate a plant map, the YAML file that maps tags of OPC UA and MQTT to plant topics.

    Args:
        file: YAML.

    Raises:
        MapError: the file, a connection or all tags are faulty.
    """
    given = read_mapping(file, MapError, "a plant map", PlantMap.model_fields)
    content = {str(key): value for key, value in given.items()}
    tags = content.pop("tags", {})
    faults: list[str] = []
    try:
        plan = PlantMap.model_validate(content)
    except ValidationError as error:
        raise MapError("\n".join(f"{file}: {line}" for line in _lines(PlantMap, error, content))) from None
    if not isinstance(tags, Mapping):
        raise MapError(f"{file}: tags: given {show(tags)}; allowed: a mapping of tags by name")
    scenario = _scenario(file, plan)
    fatal = [*_connection_faults(file, plan)]
    good: dict[str, Tag] = {}
    for name, given in tags.items():
        tag, found = _tag(str(name), given, plan, scenario, good)
        faults += [f"tags.{name}.{line}" for line in found]
        if tag is not None and not found:
            good[str(name)] = tag
    faults += [f"tags.{line}" for line in _alone(good)]
    if not good and plan.server is None:
        fatal += [f"{printable(line, 400)}" for line in faults]
        fatal.append("tags: given none that can be used; allowed: at least one tag, or a server")
    if fatal:
        raise MapError("\n".join(f"{file}: {line}" for line in fatal))
    return Warned(
        plan.model_copy(update={"tags": good}),
        [f"{file}: {printable(line, 400)}; {LEFT_OUT}" for line in faults],
        [f"{file}: {line}" for line in _warnings(plan)],
    )


def _lines(model: type[BaseModel], error: ValidationError, data: Any) -> Iterator[str]:
    """Convert schema validation errors of a plant map into messages, a line each, without the values of secrets."""
    for one in error.errors():
        path = [str(part) for part in one["loc"]]
        field, owner, used = _located(model, path)
        if one["type"] == "extra_forbidden":
            known = list(owner.model_fields)
            near = get_close_matches(path[-1], known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"allowed: {listed(known, 'nothing')}"
            yield f"{'.'.join(path)}: this key does not exist; {hint}"
            continue
        given: Any = data
        for part in path[:used]:
            given = given.get(part, _MISSING) if isinstance(given, Mapping) else _MISSING
        hidden = any(part in SECRETS for part in path)
        shown = "nothing" if given is _MISSING else "something that is not shown" if hidden else show(given)
        unit = str(data.get("unit", UNIT_OF_TAG)) if isinstance(data, Mapping) else UNIT_OF_TAG
        yield f"{'.'.join(path[:used])}: given {shown}; allowed: {allowed(field).replace(UNIT_OF_TAG, unit)}"


def _located(model: type[BaseModel], path: Sequence[str]) -> tuple[FieldInfo | None, type[BaseModel], int]:
    """Deepest schema field on a key path (None for an item of a mapping), its section, and number of parts used."""
    field: FieldInfo | None = None
    owner, used = model, 0
    inner: type[BaseModel] | None = model
    while inner is not None and used < len(path) and path[used] in inner.model_fields:
        owner, field = inner, inner.model_fields[path[used]]
        container, model_of_field = inner_model(field)
        used += 1
        if container is dict and used < len(path):
            field, used = None, used + 1  # the name of an item
        inner = model_of_field
        owner = inner or owner
    return field, owner, used


_MISSING = object()


def _scenario(file: Path, plan: PlantMap) -> Scenario | None:
    """Load the scenario that a plant map names; None if it names none."""
    if plan.scenario is None:
        return None
    try:
        path = file.parent / plan.scenario
        return load_scenario(path if path.suffix in (".yaml", ".yml") else plan.scenario)
    except ScenarioError as error:
        raise MapError("\n".join(f"{file}: scenario: {line}" for line in error.faults)) from None


def _tag(
    name: str, given: Any, plan: PlantMap, scenario: Scenario | None, others: Mapping[str, Tag]
) -> tuple[Tag | None, list[str]]:
    """Validate a tag of a plant map; returns the tag (None if it cannot be read), and error messages."""
    if not isinstance(given, Mapping):
        return None, [f"given {show(given)}; allowed: a mapping with {', '.join(Tag.model_fields)}"]
    unknown = given.get("quantity")
    if isinstance(unknown, str) and unknown not in QUANTITIES:
        near = get_close_matches(unknown, QUANTITIES, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"allowed: {', '.join(QUANTITIES)}"
        return None, [f"quantity: given {show(unknown)}; {hint}"]
    try:
        tag = Tag.model_validate(dict(given))
    except ValidationError as error:
        return None, list(_lines(Tag, error, given))
    faults = [*_source_faults(tag, plan), *_unit_faults(tag), *_target_faults(tag, scenario), *_number_faults(tag)]
    if not re.fullmatch(NAME, name):
        faults.append(f"name: given {name!r}; allowed: a letter A-Z or a-z, then such letters, digits and underscores")
    if not faults:
        faults = [*_twice(tag, others)]
    return tag, faults


def _source_faults(tag: Tag, plan: PlantMap) -> Iterator[str]:
    """Error messages about a tag's source, its address there, and its keys of fields in messages."""
    if tag.source not in plan.opcua and tag.source not in plan.mqtt:
        yield f"source: given {show(tag.source)}; allowed: {listed([*plan.opcua, *plan.mqtt], 'one of opcua or mqtt')}"
    elif tag.source in plan.opcua:
        if not NODE.fullmatch(tag.address):
            yield f"address: given {show(tag.address)}; allowed: a node such as ns=2;s=Cabin.Position or ns=2;i=7"
        for key in OF_MQTT:
            if getattr(tag, key) is not None:
                yield f"{key}: given {show(getattr(tag, key))}; allowed: for tags of mqtt only"
    elif any(sign in tag.address for sign in "+#\0") or not 0 < len(tag.address.encode()) <= LONGEST_TOPIC:
        yield f"address: given {show(tag.address)}; allowed: one topic, without + and #"
    elif tag.field is None and (tag.stamp_field or tag.quality_field):
        yield "field: given nothing; allowed: a key of the same JSON message, as with stamp_field and quality_field"


def _unit_faults(tag: Tag) -> Iterator[str]:
    """Error messages about the unit of a tag in a plant map, and about the radius or area for its conversion."""
    units = units_of(tag.quantity)
    if tag.unit not in units:
        near = [unit for unit in units if unit.lower() == tag.unit.lower()]
        hint = f"{HINTS[tag.unit]}; " if tag.unit in HINTS else f"did you mean {near[0]!r}? " if near else ""
        yield f"unit: given {show(tag.unit)}; {hint}allowed: {', '.join(units)}"
        return
    for key, units_with, of in (("radius", UNITS["N m"], "m"), ("area", UNITS["Pa"], "m^2")):
        given, needed = getattr(tag, key), tag.unit in units_with
        if needed and given is None:
            yield f"{key}: given nothing, with {tag.unit}; allowed: a number above 0, in {of}"
        elif given is not None and not needed:
            yield f"{key}: given {given:g} {of}, with {tag.unit}; allowed: only with {', '.join(units_with)}"


def _target_faults(tag: Tag, scenario: Scenario | None) -> Iterator[str]:
    """Error messages about what a tag in a plant map measures: object, axis, direction and heading."""
    quantity = QUANTITIES[tag.quantity]
    pattern = NAMES.get(quantity.of, NAME)
    known = names_of(quantity.of, scenario) if scenario is not None else None
    if not quantity.of and tag.of:
        yield f"of: given {show(tag.of)}; allowed: nothing for {tag.quantity}"
    elif quantity.of and (tag.of or quantity.of != "place"):
        if not re.fullmatch(pattern, tag.of):
            yield f"of: given {show(tag.of)}; allowed: the name of a {_kind(quantity.of)}"
        elif known is not None and tag.of not in known:
            near = get_close_matches(tag.of, known, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            assert scenario is not None
            yield f"of: given {show(tag.of)}; {hint}allowed: {listed(known, 'nothing')} of {scenario.name}"
    if quantity.axes and not (tag.axis or tag.direction or quantity.default_axis):
        yield f"axis: given nothing; allowed: one of {', '.join(quantity.axes)}"
    if tag.axis and not quantity.axes:
        yield f"axis: given {tag.axis}; allowed: nothing for {tag.quantity}"
    if tag.direction and (tag.quantity != "support_force" or tag.axis):
        yield f"direction: given {show(tag.direction)}; allowed: for a support_force without axis"
    elif tag.direction and not any(tag.direction):
        yield f"direction: given {show(tag.direction)}; allowed: a vector with a length above 0"
    if (tag.heading is None) == (tag.quantity == "wind_direction"):
        given = "nothing" if tag.heading is None else f"{tag.heading:g} deg"
        yield f"heading: given {given}; allowed: the direction of the track in deg, of a wind_direction"


def _number_faults(tag: Tag) -> Iterator[str]:
    """Error messages about the numeric settings of a tag in a plant map: sign, scale and range."""
    if tag.sign == 0:
        yield "sign: given 0; allowed: 1 or -1"
    if tag.scale == 0.0:
        yield "scale: given 0; allowed: a finite number other than 0"
    if tag.range is not None and not tag.range[0] < tag.range[1]:
        yield f"range: given {show(tag.range, tag.unit)}; allowed: two numbers, the lowest value, then a higher one"


def _twice(tag: Tag, others: Mapping[str, Tag]) -> Iterator[str]:
    """Error message about a tag in a plant map that fills the same message field as another tag."""
    for name, other in others.items():
        both = {tag.quantity, other.quantity}
        if _places(tag) & _places(other):
            given = " ".join(filter(None, (tag.quantity, tag.axis, f"of {tag.of}" if tag.of else "")))
            yield f"quantity: given {given}, which tags.{name} is already; allowed: once"
            return
        if "wind" in both and both & {*POLAR} and tag.of == other.of:
            yield f"quantity: given {tag.quantity} together with tags.{name}; allowed: wind, or {' and '.join(POLAR)}"
            return


def _places(tag: Tag) -> set[tuple[str, ...]]:
    """Places in ROS messages that a tag fills: topic, part, object and axis."""
    quantity = QUANTITIES[tag.quantity]
    axes = quantity.axes if tag.direction else (tag.axis or quantity.default_axis,)
    return {(quantity.topic, quantity.part, tag.of, axis) for axis in axes}


def _alone(good: dict[str, Tag]) -> Iterator[str]:
    """Remove tags of wind speed without wind direction, or the reverse; yields an error message for each."""
    for name, tag in [*good.items()]:
        if tag.quantity in POLAR:
            other = POLAR[1 - POLAR.index(tag.quantity)]
            if not any(one.quantity == other and one.of == tag.of for one in good.values()):
                del good[name]
                yield f"{name}.quantity: given {tag.quantity} without {other}; allowed: both, of one place"


def _kind(of: str) -> str:
    words = {
        "driven": "vehicle or drive",
        "body": "vehicle, or VEHICLE/BODY",
        "wheel": "bullwheel",
        "support": "tower, or an end of a rope such as start or ROPE/start",
        "place": "tower, or an end of a rope such as start or ROPE/start",
    }
    return words.get(of, of)


def names_of(kind: str, scenario: Scenario) -> list[str]:
    """Names in a scenario of the objects of a kind that tags can measure.

    Args:
        kind: `Quantity.of`.
        scenario: scenario of the twin.
    """
    vehicles = {name: [*one.bodies] for name, one in scenario.vehicles.items()}
    supports = [*(end for rope in scenario.cables for end in scenario.end_names(rope)), *scenario.towers]
    return {
        "driven": [*scenario.drives, *vehicles],
        "vehicle": [*vehicles],
        "body": [*vehicles, *(f"{vehicle}/{body}" for vehicle, bodies in vehicles.items() for body in bodies)],
        "support": supports,
        "wheel": [*scenario.sheaves],
        "place": supports,
    }.get(kind, [])


def _connection_faults(file: Path, plan: PlantMap) -> Iterator[str]:
    """Error messages about connections in a plant map: OPC UA servers, MQTT brokers, and the own OPC UA server."""
    for name in [*plan.opcua, *plan.mqtt]:
        if not re.fullmatch(NAME, name):
            allowed_name = "a letter A-Z or a-z, then such letters, digits and underscores"
            yield f"opcua or mqtt: given the name {printable(name)!r}; allowed: {allowed_name}"
    for name in plan.opcua.keys() & plan.mqtt.keys():
        yield f"mqtt.{name}: given a name that opcua has as well; allowed: another name"
    for path, one in connections(plan):
        if isinstance(one, OpcUa | Server):
            yield from (f"{path}.{line}" for line in _url_faults(one.url))
            if one.security != "none" and not (one.certificate and one.private_key):
                with_ = f"with security {one.security}"
                yield f"{path}.certificate: given nothing, {with_}; allowed: files certificate and private_key"
        if (one.certificate is None) != (one.private_key is None):
            missing = "private_key" if one.private_key is None else "certificate"
            yield f"{path}.{missing}: given nothing; allowed: both files, certificate and private_key, or none"
        if (one.user is None) != (one.password is None):
            missing = "password" if one.password is None else "user"
            yield f"{path}.{missing}: given nothing; allowed: both user and password, or none"
        if isinstance(one, Mqtt) and not one.tls and (one.authority or one.certificate):
            yield f"{path}.tls: given false, with certificates; allowed: true"
        for key in ("certificate", "private_key", "server_certificate", "authority"):
            given = getattr(one, key, None)
            if given is not None and (reason := unreadable(file.parent / given)):
                yield f"{path}.{key}: given {show(given)}: {reason}; allowed: a file that can be read"
        for key in ("user", "password", "private_key_password"):
            secret = getattr(one, key)
            if secret is not None:
                try:
                    secret_text(secret, file.parent)
                except MapError as error:
                    yield f"{path}.{key}: {error}"


def connections(plan: PlantMap) -> Iterator[tuple[str, Connection]]:
    """All connections of a plant map, each with its key path."""
    yield from ((f"opcua.{name}", one) for name, one in plan.opcua.items())
    yield from ((f"mqtt.{name}", mqtt) for name, mqtt in plan.mqtt.items())
    if plan.server is not None:
        yield "server", plan.server


def _url_faults(url: str) -> Iterator[str]:
    """Error messages about the URL of an OPC UA server, without the URL where it contains a password."""
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
        parts = urlsplit("")
    if parts.username is not None or parts.password is not None:
        yield f"url: given with a user name or password; allowed: opc.tcp://HOST:PORT/PATH, and user: {OUT_OF_THE_MAP}"
    elif parts.scheme != "opc.tcp" or not host or not port:
        yield f"url: given {show(url)}; allowed: opc.tcp://HOST:PORT/PATH"


def unreadable(path: Path) -> str:
    """Reason why a file cannot be read; empty for one that can."""
    try:
        with path.expanduser().open("rb") as stream:
            stream.read(1)
    except (OSError, RuntimeError) as error:
        return str(getattr(error, "strerror", None) or error)
    return ""


def secret_text(secret: Secret, directory: Path) -> str:
    """Read the text of a secret from the environment or from its file.

    Args:
        secret: variable or file that holds the secret.
        directory: directory of the map, for relative paths.

    Raises:
        MapError: the secret is missing; one line that shows nothing of it.
    """
    if (secret.environment is None) == (secret.file is None):
        raise MapError(f"given {'both' if secret.file else 'neither'}; allowed: {OUT_OF_THE_MAP}")
    if secret.environment is not None:
        text = os.environ.get(secret.environment, "")
        if not text:
            raise MapError(f"given environment {show(secret.environment)}, which is not set; allowed: one that is set")
        return text
    path = directory / str(secret.file)
    try:
        with path.expanduser().open(encoding="utf-8") as stream:
            text = stream.readline(LONGEST_SECRET).rstrip("\r\n")
    except (OSError, RuntimeError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no text in UTF-8"
        raise MapError(f"given file {show(secret.file)}: {reason}; allowed: a file with a secret") from None
    if not text:
        raise MapError(
            f"given file {show(secret.file)}, whose first line is empty; allowed: one that begins with the secret"
        )
    return text


def _warnings(plan: PlantMap) -> Iterator[str]:
    """Lines of warning about unsafe connections in a plant map."""
    for path, one in connections(plan):
        host = one.host if isinstance(one, Mqtt) else urlsplit(one.url).hostname or ""
        away = host not in LOOPBACK
        if isinstance(one, Mqtt):
            if away and one.password is not None and not one.tls:
                yield f"{path}.tls: without TLS the password can be read on the way to {host}"
        elif isinstance(one, Server) and away and one.user is None:
            yield f"{path}.user: not given, so that everybody who reaches {host} can read the estimates"
        elif isinstance(one, OpcUa) and one.security != "none" and one.server_certificate is None:
            yield f"{path}.server_certificate: not given, so that any server is trusted which answers at this address"
        if not isinstance(one, Mqtt) and away and one.password is not None and one.security == "none":
            yield f"{path}.security: none, with a password; sign_and_encrypt keeps it from being read on the way"


def open_to_others(secret: Secret, directory: Path) -> bool:
    """Whether other users of the machine can read the file of a secret."""
    if secret.file is None:
        return False
    try:
        mode = (directory / secret.file).expanduser().stat().st_mode
    except (OSError, RuntimeError):
        return False
    return bool(mode & (stat.S_IRGRP | stat.S_IROTH))
