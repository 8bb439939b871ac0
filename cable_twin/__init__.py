"""Live digital twin of a ropeway.

A `Simulation` of a scenario, from `load_scenario`, takes each `Command` and gives a `Snapshot` of each moment; an
`Ensemble` is many of them, and a `Forecaster` runs ahead of one and gives an `Outlook`. These are imported at their
first use, so that `import cable_twin` and the start of a command stay cheap.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cable_twin.ensemble import Ensemble, Forecaster
    from cable_twin.frame.records import Command
    from cable_twin.frame.snapshot import Snapshot
    from cable_twin.key_figures.outlook import Outlook
    from cable_twin.scenario import load_scenario
    from cable_twin.simulation import Simulation

__version__ = "0.2.0"
__all__ = ["Command", "Ensemble", "Forecaster", "Outlook", "Simulation", "Snapshot", "load_scenario"]

_MODULES = {
    "Command": "cable_twin.frame.records",
    "Ensemble": "cable_twin.ensemble",
    "Forecaster": "cable_twin.ensemble",
    "Outlook": "cable_twin.key_figures.outlook",
    "Simulation": "cable_twin.simulation",
    "Snapshot": "cable_twin.frame.snapshot",
    "load_scenario": "cable_twin.scenario",
}


def __getattr__(name: str) -> Any:
    """Import a public name at its first use."""
    if name not in _MODULES:
        raise AttributeError(f"module 'cable_twin' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    return value


def __dir__() -> list[str]:
    """Names of the module, with those that are not imported yet."""
    return sorted({*globals(), *__all__})
