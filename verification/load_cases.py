"""Load cases of `envelope`: closed forms, a run that stays at rest, and worst places beside a dense grid."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from scipy.optimize import root

from cable_twin.offline.envelopes.cases import LoadCase
from cable_twin.offline.envelopes.motion import Dynamic, run_dynamic
from cable_twin.offline.envelopes.places import WorstPlace, search_places
from cable_twin.offline.envelopes.runs import Job, run_case
from cable_twin.offline.envelopes.tensioning import STOPS, tensioning
from cable_twin.offline.lines.at_rest import from_scratch
from cable_twin.scenario import load_scenario
from verification import Result, case
from verification.counterweights import bar
from verification.models import GRAVITY
from verification.statics import catenary_end

TENSION, SAG = "rope_tension/ropes.cable/highest", "sag/ropes.cable.start+end/highest"
LENGTH, AXIAL, PULL = 50.0, 5e5, 1000.0  # m, N, N of a straight rope without weight and its counterweight


def figures_of(source: Any, changes: Mapping[str, Any], *, stops: bool = False) -> dict[str, float]:
    """Key figures by id of one load case of a scenario, as `envelope` has them."""
    scenario = load_scenario(source, changes)
    found = run_case(Job(LoadCase("a", "a", scenario, changes, stops=stops), 1))
    assert not found.fault, found.fault
    return {str(one.id): one.value for one in found.figures}


def pull_of(end: np.ndarray, weight: float, stiffness: float, length: float) -> np.ndarray:
    """Force (H, V) in N at the start of an elastic catenary from the origin to `end` (2,) in m."""
    chord = float(np.linalg.norm(end))
    begin = max(stiffness * (chord / length - 1.0), 0.3 * weight * length)
    first = np.array([begin * end[0] / chord, begin * end[1] / chord - 0.5 * weight * length])
    return root(lambda pull: catenary_end(pull, weight, stiffness, length) - end, first, tol=1e-13).x  # type: ignore[no-any-return]


@case("span in load cases", "elastic catenary (Irvine 1981) with thermal strain and the weight of ice")
def spans() -> Iterator[Result]:
    """Tension at the higher end of a rope without bending stiffness, cold and hot, bare and with ice."""
    length, axial, end = 203.0, 2e7, np.array([198.0, 35.0])
    source = {
        "cable": {
            "unstrained_length": length,
            "mass_per_length": 2.0,
            "axial_stiffness": axial,
            "bending_stiffness": 0.0,
            "thermal_expansion": 1.2e-5,
            "reference_temperature": 10.0,
            "diameter": 0.03,
            "elements": 200,
            "start": {"position": [0.0, 0.0]},
            "end": {"position": end.tolist()},
        },
    }
    for degrees in (-30.0, 50.0):
        for ice in (0.0, 3.0):
            weight, longer = (2.0 + ice) * GRAVITY, 1.0 + 1.2e-5 * (degrees - 10.0)
            # stretch 1 + T/EA + thermal strain: the catenary of a smaller span
            h, v = pull_of(end / longer, weight, longer * axial, length)
            expected = float(np.hypot(h, v + weight * length))
            got = figures_of(source, {"air.temperature": degrees, "cable.ice": ice})[TENSION]
            yield Result(f"tension at {degrees:+g} degC, {ice:g} kg/m of ice", "N", expected, got, 1e-6 * expected)


@case("tensioning in load cases", "Hooke: EA (x / L - thermal strain) at a travel x; travel by the thermal strain")
def straight_ropes() -> Iterator[Result]:
    """A straight rope whose counterweight is free, stuck, at its limits, and free within them, cold and hot."""
    source, stretch = bar(LENGTH, AXIAL, PULL), LENGTH * PULL / AXIAL
    source["cable"] |= {"thermal_expansion": 12e-6, "reference_temperature": 10.0}
    source["cable"]["end"] = {**source["cable"]["end"], "travel": [0.08, 0.12]}
    for degrees in (-20.0, 10.0, 40.0):
        warmer, air = degrees - 10.0, {"air.temperature": degrees}
        expected = stretch + 12e-6 * warmer * LENGTH
        got = figures_of(source, air)["counterweight_travel/ropes.cable.end/highest"]
        yield Result(f"travel at {degrees:+g} degC, free", "m", expected, got, 1e-9)
        for given, travel in (("least_travel", 0.08), ("most_travel", 0.12), (0.1, 0.1)):
            changes = air | tensioning(load_scenario(source), given)
            expected = AXIAL * (travel / LENGTH - 12e-6 * warmer)
            got = figures_of(source, changes)[TENSION]
            yield Result(f"tension at {degrees:+g} degC, {given}", "N", expected, got, 1e-6 * expected)
    for length, travel in ((49.95, 0.08), (50.05, 0.12)):  # free it would be at 0.05 and 0.15 m
        changes = {"cable.unstrained_length": length, "air.temperature": 10.0} | tensioning(
            load_scenario(source), STOPS
        )
        expected = AXIAL * ((50.0 + travel) / length - 1.0)
        got = figures_of(source, changes, stops=True)[TENSION]
        yield Result(f"tension of {length:g} m at its stop", "N", expected, got, 1e-6 * expected)
    got = figures_of(source, tensioning(load_scenario(source), STOPS), stops=True)[TENSION]
    yield Result("tension of 50 m within its limits", "N", PULL, got, 1e-6 * PULL)


def loop_source(travel: tuple[float, float] = (-1.0, 1.0)) -> dict[str, Any]:
    """Scenario of two strands of 208.5 m between a drive at the top and a counterweight, without towers."""
    strand = {
        "unstrained_length": 208.5,
        "mass_per_length": 6.0,
        "axial_stiffness": 60e6,
        "bending_stiffness": 0.0,
        "elements": 100,
        "thermal_expansion": 1.2e-5,
    }
    bottom, top = {"position": [0.0, 0.0]}, {"position": [200.0, 60.0]}
    return {
        "ropes": {"up": {**strand, "start": bottom, "end": top}, "down": {**strand, "start": top, "end": bottom}},
        "sheaves": {
            "drive": {"radius": 2.0, "joins": ["up.end", "down.start"], "inertia": 40e3, "drive": {"name": "motor"}},
            "return": {
                "radius": 2.0,
                "joins": ["down.end", "up.start"],
                "inertia": 8e3,
                "counterweight": {"direction": [-0.95, -0.312], "mass": 20e3, "travel": list(travel)},
            },
        },
    }


@case("bullwheels in load cases", "elastic catenaries of strands at a travel; capstan ln(T1/T2) / (μ wrap)")
def bullwheels() -> Iterator[Result]:
    """Both strands from a bullwheel that is held at a limit of its travel, and the adhesion used with ice on one."""
    source, way = loop_source(), np.array([-0.95, -0.312]) / np.hypot(0.95, 0.312)
    for given, travel in (("least_travel", -1.0), ("stuck", 0.0), ("most_travel", 1.0)):
        end = np.array([200.0, 60.0]) - travel * way
        h, v = pull_of(end, 6.0 * GRAVITY, 60e6, 208.5)
        found = figures_of(source, tensioning(load_scenario(source), given))
        expected = float(np.hypot(h, v))
        for strand, support in (("up", "ropes.up.start"), ("down", "ropes.down.end")):
            got = found[f"support_load/{support}/highest"]
            yield Result(f"tension of {strand} at the wheel, {given}", "N", expected, got, 1e-6 * expected)
    found = figures_of(loop_source((-9.0, 9.0)), {"ropes.up.ice": 4.0})
    ends = [found[f"support_load/{support}/highest"] for support in ("ropes.up.end", "ropes.down.start")]
    used = abs(np.log(ends[0] / ends[1])) / (0.22 * np.pi)
    got = found["adhesion_used/sheaves.drive/highest"]
    yield Result("adhesion used at the drive, ice on one strand", "-", float(used), got, 1e-6)
    below = [found[f"support_load/{support}/highest"] for support in ("ropes.up.start", "ropes.down.end")]
    yield Result("ratio of both strands at the free wheel", "-", 1.0, below[0] / below[1], 1e-6)


@case("load case beside a run without commands", "equilibrium: the run stays where it begins", needs_jit=True)
def at_rest() -> Iterator[Result]:
    """Key figures of a case at rest and the extremes of a run of 5 s without commands, the worst of all figures."""
    for name, changes in (("aerial_tramway", {}), ("chairlift", {"air.temperature": -20.0})):
        still = figures_of(name, changes)
        scenario = load_scenario(name, changes)
        moved, fault = run_dynamic(scenario, Dynamic((), 5.0, None))
        assert not fault, fault
        values = {str(one.id): one.value for one in moved}
        for quantity in ("rope_tension", "sag", "support_load"):
            keys = [key for key in still if key.startswith(f"{quantity}/") and key in values]
            worst = max(abs(values[key] / still[key] - 1.0) for key in keys)
            yield Result(f"{name}: {len(keys)} figures of {quantity}, worst", "-", 0.0, worst, 1e-6)


def _worst(tried: Callable[[int], Any], figure: str, points: int) -> Iterator[Result]:
    """Worst value of a figure by search, and on a grid ten times as dense, of which the search may miss nothing."""
    found, sense = tried(points).worst(figure)[1], -1.0 if figure.endswith("/lowest") else 1.0
    dense = tried(10 * (points - 1) + 1)
    grid = max(sense * one[figure].value for one in dense.tried.values() if figure in one) * sense
    missed = max(sense * (grid - found), 0.0) / abs(grid)
    yield Result(f"{figure}: missed of {abs(grid):.6g}", "-", 0.0, missed, 0.0)


@case("worst place by search", "grid ten times as dense: the search is at least as bad", needs_jit=True, long=True)
def places() -> Iterator[Result]:
    """The cabin of a tramway, and a single full chair anywhere on the loop of a lift."""
    for name, changes, one, points, figures in (
        ("aerial_tramway", {}, False, 12, (TENSION, "support_load/towers.tower/highest")),
        ("chairlift", {"carriers.loaded": [1]}, True, 56, ("sag/ropes.up.tower_4_up+tower_5_up/highest",)),
    ):
        scenario = load_scenario(name, changes)
        for figure in figures:

            def tried(count: int, scenario: Any = scenario, figure: str = figure, one: bool = one) -> Any:
                wanted = (figure,) if count < 100 else ()
                return search_places(scenario, WorstPlace(count, wanted, one), from_scratch)

            yield from _worst(tried, figure, points)
