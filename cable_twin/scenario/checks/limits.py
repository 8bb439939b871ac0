"""Consistency checks of the rule profiles that `limits` names."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

from cable_twin.scenario.checks.fault import Fault, Phrase, refuse
from cable_twin.scenario.schema import Scenario

RULES = Path(__file__).resolve().parents[2] / "rules"  # shipped profiles, a YAML file each
SUFFIXES = (".yaml", ".yml")


@cache
def profile_names() -> tuple[str, ...]:
    """Names of the shipped rule profiles, sorted."""
    return tuple(sorted(file.stem for file in RULES.glob("*.yaml")))


def is_file(profile: str) -> bool:
    """Whether a rule profile is given as the path of a file and not by the name of a shipped one."""
    return profile.endswith(SUFFIXES)


def limit_faults(scenario: Scenario) -> Iterator[Fault]:
    """Errors in a scenario's rule profiles: unknown or repeated names, and load cases of other profiles."""
    given = [name for name in scenario.limits.profile or () if isinstance(name, str)]
    for number, name in enumerate(given):
        path = ("limits", "profile", number)
        if not is_file(name) and name not in profile_names():
            yield refuse(path, name, f"{', '.join(profile_names())}, or the path of a YAML file", "no such profile")
        elif name in given[:number]:
            yield refuse(path, name, "each profile once", "given twice")
    known = [Path(name).stem for name in given]
    for number, case in enumerate(scenario.limits.load_cases or ()):
        if isinstance(case, str) and case.partition(".")[0] not in known:
            names = ", ".join(f"{name}.LOAD_CASE" for name in known)
            why = "" if names else "without a profile there is no load case"
            yield refuse(("limits", "load_cases", number), case, names or str(Phrase("none")), why)
