"""Map of a plant's tags to topics: its sections as a schema, with the unit and meaning of each key."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from cable_twin.ros.door.quantities import QUANTITIES
from cable_twin.scenario.sections.quantities import FromList, OneLine, Section
from cable_twin.scenario.sections.quantities import quantity as number

Range = Annotated[tuple[float, float], FromList]
Direction = Annotated[tuple[float, float, float], FromList]
Words = Annotated[tuple[str, ...], FromList]
Name = Literal[tuple(QUANTITIES)]  # type: ignore[valid-type]  # known when it is imported
UNIT_OF_TAG = "unit of the tag"
OUT_OF_THE_MAP = "a mapping {environment: NAME} or {file: PATH}, so that it is not in the map"


def _secret(description: str) -> Any:
    return Field(None, description=description, json_schema_extra={"allowed": OUT_OF_THE_MAP})


class Secret(Section):
    """Source of a user name or password kept out of the map: either an environment variable or a file."""

    environment: OneLine | None = Field(None, description="variable of the environment that holds it")
    file: OneLine | None = Field(None, description="file whose first line it is")


class Clocked(Section):
    """Settings common to connections whose samples are stamped by another clock."""

    clock: Literal["correct", "trust"] = Field(
        "correct", description="shift stamps by the measured offset of the other clock, or take them as they are"
    )
    clock_tolerance: float = number(
        "s",
        "offset from which on a clock that is measured one way only is another one, and its messages not just late",
        10.0,
        gt=0,
    )
    retry: float = number("s", "longest wait between two attempts to connect, which begin at 0.5 s", 30.0, ge=0.5)


class OpcUa(Clocked):
    """OPC UA server whose variables are subscribed to."""

    url: OneLine = Field(description="endpoint, opc.tcp://HOST:PORT/PATH, without user or password")
    security: Literal["none", "sign", "sign_and_encrypt"] = Field(
        "none", description="message security; sign and sign_and_encrypt with the policy Basic256Sha256"
    )
    certificate: OneLine | None = Field(None, description="file with the certificate of the door, PEM or DER")
    private_key: OneLine | None = Field(None, description="file with its private key")
    private_key_password: Secret | None = _secret("password of that file")
    server_certificate: OneLine | None = Field(
        None, description="file with the certificate that the server has to have; null: any, which is warned of"
    )
    user: Secret | None = _secret("user name; null: anonymous")
    password: Secret | None = _secret("its password")
    interval: float = number("s", "publishing interval of the subscription", 0.1, ge=0.01, le=10)
    timeout: float = number("s", "time in which the server has to answer", 4.0, ge=0.5, le=60)
    stamp: Literal["source", "server", "receipt"] = Field(
        "source", description="stamp of a sample: that of the sensor, of the server, or its receipt"
    )


class Mqtt(Clocked):
    """MQTT broker whose topics are subscribed to."""

    host: OneLine = Field(description="name or address of the broker")
    port: int = number("-", "its port, usually 8883 with TLS", 1883, ge=1, le=65535)
    tls: bool = Field(False, description="TLS; the broker's certificate and host name are checked")
    authority: OneLine | None = Field(
        None, description="file with the certificates of authorities, PEM; null: those of the system"
    )
    certificate: OneLine | None = Field(None, description="file with the certificate of the door, PEM")
    private_key: OneLine | None = Field(None, description="file with its private key")
    private_key_password: Secret | None = _secret("password of that file")
    user: Secret | None = _secret("user name; null: anonymous")
    password: Secret | None = _secret("its password")
    client: OneLine = Field("", description="client identifier; empty: a new one each time")
    quality_of_service: int = number("-", "of the subscriptions", 1, ge=0, le=2)
    keep_alive: int = number("s", "time without messages after which the broker is asked whether it is there", 10, ge=1)
    stamp: Literal["source", "receipt"] = Field(
        "source", description="stamp of a sample: that in the message (`stamp_field`), or its receipt"
    )


class Tag(Section):
    """Measured value: where it is in the plant, and what it is for the twin."""

    source: OneLine = Field(description="name of one of `opcua` or `mqtt`")
    address: OneLine = Field(
        description="node of OPC UA, as in ns=2;s=Cabin.Position or nsu=URI;s=Cabin.Position, or topic of MQTT"
    )
    field: OneLine | None = Field(
        None, description="of MQTT: dotted key of the value in a JSON message; null: the message is the number"
    )
    stamp_field: OneLine | None = Field(
        None, description="of MQTT: dotted key of the stamp, ISO 8601 or s, ms, us or ns since 1970"
    )
    quality_field: OneLine | None = Field(None, description="of MQTT: dotted key of the quality")
    good: Words = Field(
        ("good", "ok", "true", "192"), description="of MQTT: texts in `quality_field` that mean good, in any case"
    )
    quantity: Name = Field(description="what is measured")  # type: ignore[valid-type]
    of: OneLine = Field(
        "",
        description="measured object: a vehicle, drive, support (tower, start, end, or of several ropes ROPE/start and "
        "ROPE/end) or bullwheel, or VEHICLE/BODY",
    )
    axis: Literal["x", "y", "z"] | None = Field(None, description="axis of a vector; null: z of a support_force")
    direction: Direction | None = number(
        "-", "of a support_force: direction of the load cell, x, y, z, in place of an axis", None
    )
    unit: OneLine = Field(description="unit of the tag, which is converted")
    scale: float = number("-", "factor of the raw value", 1.0)
    offset: float = number(UNIT_OF_TAG, "added after the factor", 0.0)
    sign: int = number("-", "-1 where the plant counts the other way", 1, ge=-1, le=1)
    radius: float | None = number("m", "at which a torque acts, which becomes a force", None, gt=0)
    area: float | None = number("m^2", "on which a pressure acts, which becomes a force", None, gt=0)
    heading: float | None = number(
        "deg", "of a wind_direction: direction in which the track leads, clockwise from north", None, ge=-360, le=360
    )
    range: Range | None = number(
        UNIT_OF_TAG, "lowest and highest possible value, after scale, offset and sign; others are left out", None
    )
    deviation: float = number(UNIT_OF_TAG, "standard deviation, which an Imu message tells; 0: unknown", 0.0, ge=0)
    rate: float = number("Hz", "samples asked for, and most messages", 10.0, gt=0, le=1000)
    stale_after: float = number("s", "time without a sample after which this is said", 5.0, gt=0)
    hold: bool = Field(
        False, description="of a server that tells changes only: repeat the last good value while it is connected"
    )
    quality: Literal["good", "uncertain"] = Field("good", description="lowest quality that is taken")


class Server(Section):
    """OPC UA server of the door, with the estimates and alarms of a twin."""

    url: OneLine = Field("opc.tcp://127.0.0.1:4841", description="where it listens; 0.0.0.0 is the whole network")
    twin: OneLine = Field("/cable_twin", description="full name of the twin's node")
    security: Literal["none", "sign", "sign_and_encrypt"] = Field(
        "none", description="message security that clients need; others than none with the policy Basic256Sha256"
    )
    certificate: OneLine | None = Field(None, description="file with its certificate, PEM or DER")
    private_key: OneLine | None = Field(None, description="file with its private key")
    private_key_password: Secret | None = _secret("password of that file")
    user: Secret | None = _secret("user name that clients need; null: anonymous ones may read")
    password: Secret | None = _secret("its password")
    stale_after: float = number("s", "silence of the twin after which values are uncertain", 5.0, gt=0)


class PlantMap(Section):
    """Complete map of a plant: where its tags are, what they are, and where the twin's estimates go."""

    description: OneLine = Field("", description="what it is for")
    scenario: OneLine | None = Field(
        None, description="name or path of the twin's scenario, whose vehicles, drives and supports tags are `of`"
    )
    opcua: dict[str, OpcUa] = Field({}, description="OPC UA servers by name")
    mqtt: dict[str, Mqtt] = Field({}, description="MQTT brokers by name")
    tags: dict[str, Tag] = Field({}, description="tags by name")
    server: Server | None = Field(None, description="OPC UA server of the door; null: none")
