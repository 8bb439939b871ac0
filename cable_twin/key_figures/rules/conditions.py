"""Facts of a ropeway for conditions and formulas of rules: from the scenario and its `limits.installation`."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from math import hypot
from typing import Any, Literal, get_args, get_origin

from cable_twin.key_figures.figure import KeyFigure
from cable_twin.key_figures.rules.expressions import MissingError
from cable_twin.key_figures.rules.subjects import Subjects, rope_roles
from cable_twin.key_figures.stops import EMERGENCY
from cable_twin.scenario import Scenario
from cable_twin.scenario.checks.fault import scalar, show
from cable_twin.scenario.sections.limits import Installation

REVERSIBLE, CIRCULATING, MONOCABLE = "reversible_bicable", "circulating_bicable", "monocable"
SYSTEMS = {
    REVERSIBLE: "vehicles on track ropes, to and fro",
    CIRCULATING: "vehicles on track ropes, all round a loop",
    MONOCABLE: "vehicles on a rope that carries and pulls them",
}
OPERATORS: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
}
# facts of the scenario, with meaning and unit; those of `limits.installation` are facts by the names of its keys
OF_SCENARIO = {
    "carriage_brake": ("a brake of a carriage on its track rope", ""),
    "haul_ropes": ("haul ropes of a vehicle", "-"),
    "vehicles": ("vehicles in the scenario", "-"),
    "rated_speed": ("limit of the speed of the drive", "m/s"),
    "span": ("longest span, chord", "m"),
    "sag": ("largest sag of the run, of spans with a chord above 100 m", "m"),
    "friction": ("friction of the rope on the bullwheel", "-"),
    "wrap": ("wrap of the rope on the bullwheel", "rad"),
    "derailment_ratio": ("lateral over normal force at which the rope leaves the tower", "-"),
}
ON_DRIVE = "service_brake", "emergency_brake"  # brakes of the drive of a carriage
OF_SUBJECT = ("friction", "wrap", "derailment_ratio")  # of the subject of a figure: in formulas, not in conditions
NUMBERS = {"persons": "-", "snow": "m", "wheels": "-", "grip_force": "N"}  # keys of `installation`, with their units
VARIABLES = {name: unit for name, (_, unit) in OF_SCENARIO.items() if unit} | NUMBERS  # of formulas, with their units
CHOICES: dict[str, tuple[Any, ...]] = {
    name: get_args(kind) if get_origin(kind) is Literal else (True, False) if kind is bool else ()
    for name, field in Installation.model_fields.items()
    for kind in [scalar(field.annotation)[0]]
} | {name: () if unit else (True, False) for name, (_, unit) in OF_SCENARIO.items() if name not in OF_SUBJECT}


def condition_fault(name: str, value: Any) -> str:
    """Error in a rule condition that compares one fact with a value, in a line; empty for a valid condition."""
    if name not in CHOICES:
        return f"given {show(value)}: no such fact; allowed: {', '.join(CHOICES)}"
    choices, given = CHOICES[name], value if isinstance(value, list) else [value]
    if choices:
        wrong = [one for one in given if not any(type(one) is type(own) and one == own for own in choices)]
        words = ", ".join(show(choice).lower() if isinstance(choice, bool) else str(choice) for choice in choices)
        return f"given {show(value)}; allowed: {words}" if wrong or not given else ""
    for one in given:
        number = one if isinstance(one, int | float) else _bound(one)[1] if isinstance(one, str) else None
        if number is None or isinstance(one, bool):
            return f"given {show(value)}; allowed: a number, a list of numbers, or a text as '> 4' or '<= 4'"
    return ""


def holds(when: Mapping[str, Any], facts: Mapping[str, Any]) -> bool:
    """Whether the condition of a rule holds for the facts of a ropeway.

    Raises:
        MissingError: the condition depends on a fact that is not stated, and no other part of it fails.
    """
    unknown = [name for name in when if facts.get(name) is None]
    for name, wanted in when.items():
        if name not in unknown and not any(_fits(facts[name], one) for one in _several(wanted)):
            return False
    if unknown:
        raise MissingError(unknown[0])
    return True


def _several(wanted: Any) -> list[Any]:
    return wanted if isinstance(wanted, list) else [wanted]


def _fits(fact: Any, wanted: Any) -> bool:
    compare, number = _bound(wanted) if isinstance(wanted, str) else (None, None)
    return bool(fact == wanted if compare is None or number is None else compare(fact, number))


def _bound(text: str) -> tuple[Callable[[float, float], bool] | None, float | None]:
    """Parse a comparison such as '> 4' into its operator and number; both None for any other text."""
    for sign, compare in OPERATORS.items():
        if text.startswith(sign):
            try:
                return compare, float(text.removeprefix(sign))
            except ValueError:
                return None, None
    return None, None


def system_of(scenario: Scenario) -> str:
    """Kind of ropeway of a scenario, one of `SYSTEMS`."""
    if scenario.carriers is not None and scenario.carriers.tracks:
        return CIRCULATING
    return REVERSIBLE if "track_ropes" in rope_roles(scenario).values() else MONOCABLE


def facts_of(scenario: Scenario, subjects: Subjects) -> dict[str, Any]:
    """Facts of a scenario for rules by name, None where not stated; without facts of single bullwheels or towers."""
    stated = scenario.limits.installation.model_dump()
    hauled = [one for one in scenario.carriages.values() if one.drive.haul_rope is not None]
    loops = {one.before for one in scenario.strands.values()}
    limits = [one.limits.speed for one in scenario.drives.values()]
    limits += [one.drive.limits.speed for one in scenario.carriages.values() if one.joint == "sliding"]
    rated = max((speed for speed in limits if speed is not None), default=None)
    spans = [hypot(*chord) for chords in subjects.chords.values() for chord in chords]
    bicable = system_of(scenario) != MONOCABLE
    return stated | {
        "carriage_brake": any(one.drive.track_rope_brake is not None for one in scenario.carriages.values()),
        "haul_ropes": (1 if hauled or loops else None) if bicable else None,
        "vehicles": len(subjects.vehicles),
        "rated_speed": rated,
        "span": max(spans, default=None),
    }


def brakes_of(scenario: Scenario, stop: KeyFigure) -> tuple[list[str], list[str]]:
    """Brakes of a drive, and what has made one of its stops: these brakes, or the drive itself.

    Brakes of carriages on their track ropes are none of a drive.

    Args:
        scenario: scenario of the run.
        stop: key figure of the stop, which its place describes.
    """
    kind, _, name = stop.id.subject.partition(".")
    if kind == "drives":
        brakes = [f"brake of {one}" for one, wheel in scenario.sheaves.items() if wheel.brake is not None]
        driven = f"brake of {scenario.drives[name].sheave}" not in brakes
        acting = [*(["drive"] if driven else []), *brakes]
    else:
        drive = scenario.carriages[name].drive
        brakes = [one for one in ON_DRIVE if getattr(drive, one) is not None]
        acting = list(drive.emergency_stop)
    return brakes, acting if stop.place.startswith(EMERGENCY) else []


def subject_facts(scenario: Scenario, subject: str) -> dict[str, float]:
    """Facts of a key figure's subject for rules: friction and wrap of a bullwheel, derailment ratio of a tower."""
    kind, _, name = subject.partition(".")
    if kind == "sheaves" and name in scenario.sheaves:
        wheel = scenario.sheaves[name]
        return {"friction": wheel.friction, "wrap": wheel.wrap}
    if kind == "towers" and name in scenario.towers:
        return {"derailment_ratio": scenario.towers[name].derailment_ratio}
    return {}
