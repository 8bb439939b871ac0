"""Reference of plant maps generated from the schema: a page for readers, a JSON schema for editors.

python -m cable_twin.ros.door.reference        writes both into docs/ anew
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from cable_twin.ros.door.plant_map import UNIT_OF_TAG, Mqtt, OpcUa, PlantMap, Secret, Server, Tag
from cable_twin.ros.door.quantities import QUANTITIES, units_of
from cable_twin.ros.door.tags_to_messages import PLANT
from cable_twin.scenario.checks.fault import allowed

PAGE, JSON_SCHEMA = "plant_map_reference.md", "plant_map.schema.json"
SECTIONS: dict[str, type[BaseModel]] = {
    "The whole file": PlantMap,
    "`opcua.NAME`": OpcUa,
    "`mqtt.NAME`": Mqtt,
    "`tags.NAME`": Tag,
    "`server`": Server,
    "`user`, `password`, `private_key_password`": Secret,
}
OBJECTS = {
    "driven": "vehicle or drive",
    "body": "vehicle or VEHICLE/BODY",
    "wheel": "bullwheel",
    "place": "tower or station, or none",
    "": "none",
}
HEAD = f"""\
# Plant map reference

Every key of a map for `plant_door`, written from the schema by `python -m cable_twin.ros.door.reference`. `NAME` is
a name that the file chooses. [doors.md](doors.md) has examples.

Editors check a file while it is written where its first line names the JSON schema, as `examples/plant_map.yaml` does:

    # yaml-language-server: $schema=../docs/{JSON_SCHEMA}
"""


def page() -> str:
    """Reference of plant maps as a page in Markdown."""
    parts = [HEAD]
    for title, model in SECTIONS.items():
        lines = "\n".join(
            f"| `{name}` | {' | '.join(_cell(cell) for cell in _cells(field))} |"
            for name, field in model.model_fields.items()
        )
        head = "| key | unit | default | allowed | meaning |\n| --- | --- | --- | --- | --- |"
        parts.append(f"## {title}\n\n{' '.join((model.__doc__ or '').split())}\n\n{head}\n{lines}\n")
    rows = []
    for name, one in QUANTITIES.items():
        topic = f"`{PLANT}/{one.topic.replace('OF', 'NAME')}`"
        cells = f"`{name}`", one.help, one.unit, ", ".join(units_of(name)), topic, OBJECTS.get(one.of, one.of)
        rows.append(f"| {' | '.join(cells)} | {', '.join(one.axes) or '-'} |")
    head = "| quantity | meaning | unit of the topic | units of tags | topic | `of` | `axis` |"
    text = "Units of torque need `radius` (m), those of pressure `area` (m^2)."
    parts.append(
        f"## Quantities\n\n{text}\n\n{head}\n| --- | --- | --- | --- | --- | --- | --- |\n{chr(10).join(rows)}\n"
    )
    return "\n".join(parts)


def json_schema() -> dict[str, Any]:
    """JSON schema of a plant map."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **PlantMap.model_json_schema()}


def write(directory: Path) -> list[Path]:
    """Write the reference page and the JSON schema into a directory; returns the files."""
    files = [directory / PAGE, directory / JSON_SCHEMA]
    files[0].write_text(page(), encoding="utf-8")
    files[1].write_text(json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return files


def _cells(field: FieldInfo) -> tuple[str, str, str, str]:
    """Table cells of a key of plant maps: unit, default, allowed values and meaning."""
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    unit = str(extra.get("unit", ""))
    value = None if field.is_required() else field.get_default(call_default_factory=True)
    default = "needed" if field.is_required() else json.dumps(value) if not isinstance(value, float) else f"{value:g}"
    if isinstance(value, str):
        default = value or '""'
    meaning = (field.description or "").removesuffix(f" ({unit})")
    text = "one of the quantities below" if "position" in allowed(field, unit=False) else allowed(field, unit=False)
    return unit if unit != UNIT_OF_TAG else "that of the tag", default, text, meaning


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    for written in write(Path(sys.argv[1] if len(sys.argv) > 1 else "docs")):
        print(written)
