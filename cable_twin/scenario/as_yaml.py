"""Plain data of a scenario as YAML text."""

from __future__ import annotations

from io import StringIO
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.representer import SafeRepresenter


class _Representer(SafeRepresenter):
    """YAML floats with a decimal point: 1e-06 is a text in YAML 1.1, 1.0e-06 is a number."""

    def represent_float(self, value: float) -> Any:
        text = repr(value)
        return self.represent_scalar(
            "tag:yaml.org,2002:float", text.replace("e", ".0e") if "e" in text and "." not in text else text
        )


_Representer.add_representer(float, _Representer.represent_float)


def as_yaml(data: dict[str, Any]) -> str:
    """YAML text, readable as YAML 1.1 and 1.2 alike."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Representer = _Representer
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # bodies in the order of the chain
    yaml.default_flow_style = None
    yaml.width = 120
    text = StringIO()
    yaml.dump(data, text)
    return text.getvalue()


__all__ = ["as_yaml"]
