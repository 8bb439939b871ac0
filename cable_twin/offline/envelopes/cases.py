"""Reader of load case files: scenario changes by dotted key, loading plans, combinations of factor levels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

from cable_twin.basics.limited_yaml import read_mapping
from cable_twin.offline.envelopes.motion import Dynamic, DynamicError, read_dynamic
from cable_twin.offline.envelopes.places import WorstPlace, read_worst_place
from cable_twin.offline.envelopes.tensioning import STOPS, TensioningError, tensioning
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.scenario.checks.fault import listed, show

PLANS = {
    "empty": "no payload anywhere",
    "full": "the whole capacity everywhere",
    "up_full": "full on the first rope, empty on the others",
    "down_full": "empty on the first rope, full on the others",
    "every_second": "every second vehicle full, the others empty",
    "one": "one vehicle full and the others empty, a case for each vehicle that can be it",
}
OF_FILE = ("cases", "product")
OF_PRODUCT = ("name", "loading", "tensioning", "set", "load_cases", "dynamic", "worst_place")
KEYS = ("id", *OF_PRODUCT)
ALONE = ("loading", "tensioning", "dynamic", "worst_place")  # keys that one factor of a product may give
MOST = 20_000  # cases of a file


class LoadCase(NamedTuple):
    """Load case: id, name for people, scenario, and its changes from the base scenario by dotted key.

    `dynamic` is its run, `worst_place` the search for the worst place of its vehicle, None without.
    """

    id: str
    name: str
    scenario: Scenario
    changes: Mapping[str, Any]
    dynamic: Dynamic | None = None
    worst_place: WorstPlace | None = None
    stops: bool = False  # whether tensioning devices are held at the limits of their travel

    @property
    def moves(self) -> bool:
        """Whether the load case is a run, not a line at rest."""
        return self.dynamic is not None


def case_columns(case: LoadCase) -> dict[str, Any]:
    """Convert a load case into plain data for the JSON of its results; `case_again` is the inverse.

    Args:
        case: a load case.
    """
    place = None if case.worst_place is None else {"one": case.worst_place.one}
    own = {"dynamic": case.moves, "worst_place": place, "stops": case.stops}
    return {"id": case.id, "name": case.name, "changes": dict(case.changes), **own}


def case_again(columns: Mapping[str, Any], base: Scenario) -> LoadCase:
    """Load case at rest from its plain data in JSON, without grid and key figures of a search for the worst place.

    Args:
        columns: as `case_columns` makes them; of earlier versions without `worst_place` and `stops`.
        base: scenario that the case changes.

    Raises:
        ScenarioError: the changes do not fit the scenario.
    """
    place, changes = columns.get("worst_place"), dict(columns["changes"])
    searched = WorstPlace(0, (), bool(place.get("one"))) if isinstance(place, Mapping) else None
    scenario = load_scenario(base.resolved(), changes)
    return LoadCase(columns["id"], columns["name"], scenario, changes, None, searched, bool(columns.get("stops")))


class CaseError(ValueError):
    """Errors in a file of load cases, one line each."""


def read_cases(file: Path, source: Any, changes: Mapping[str, Any]) -> list[LoadCase]:
    """Read the load cases of a YAML file for a scenario, and check the scenario of each.

    Args:
        file: with `cases`, a list, and `product`, mappings of which all combinations are cases.
        source: name, path or data of a scenario, as for `load_scenario`.
        changes: values by dotted key that hold for all cases.

    Raises:
        CaseError: with every fault of the file and of the scenarios of its cases, one line each.
        ScenarioError: the scenario itself is invalid.
    """
    base = load_scenario(source, changes)
    content = read_mapping(file, CaseError, "load cases", OF_FILE)
    faults: list[str] = []
    if unknown := [key for key in content if key not in OF_FILE]:
        faults.append(f"{unknown[0]}: this key does not exist; allowed: {', '.join(OF_FILE)}")
    parts = [*_listed(content.get("cases"), faults), *_combined(content.get("product"), faults)]
    if not parts and not faults:
        faults.append("given no case; allowed: a list `cases`, or a mapping `product`")
    seen: set[str] = set()
    found = []
    parts = [each for part in parts for each in _each_vehicle(base, *part)]
    if len(parts) > MOST:
        faults.append(f"given {len(parts)} cases; allowed: at most {MOST}")
        parts = []
    for id_, one in parts:
        if id_ in seen:
            faults.append(f"{id_}: given twice; allowed: each id once")
            continue
        seen.add(id_)
        try:
            values = _changes(base, one)
            scenario = load_scenario(source, {**changes, **values})
            given = one.get("dynamic")
            dynamic = None if given is None else read_dynamic(given, file.parent, scenario)
            place, stops = _worst_place(one, scenario), one.get("tensioning") == STOPS
            if stops and dynamic is not None:
                faults.append(f"{id_}: tensioning: given {STOPS!r} beside dynamic; allowed: a case at rest")
        except DynamicError as error:
            faults += [f"{id_}: {line}" for line in str(error).splitlines()]
        except ScenarioError as error:
            faults += [f"{id_}: {fault.partition(': ')[2]}" for fault in error.faults]
        except (CaseError, TensioningError) as error:
            faults.append(f"{id_}: {error}")
        else:
            found.append(LoadCase(id_, str(one.get("name", id_)), scenario, values, dynamic, place, stops))
    if faults:
        raise CaseError("\n".join(f"{file}: {fault}" for fault in faults))
    return found


def _listed(cases: Any, faults: list[str]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield id and entry of each load case in the list `cases` of a file; error lines are added to `faults`."""
    if cases is None:
        return
    if not isinstance(cases, list):
        faults.append(f"cases: given {show(cases)}; allowed: a list of mappings with {', '.join(KEYS)}")
        return
    for number, one in enumerate(cases):
        id_ = one.get("id") if isinstance(one, Mapping) else None
        if not _is_name(id_):
            given = f"{show(one)} without an id" if id_ is None else f"{show(one)} with the id {show(id_)}, no text"
            faults.append(f"cases.{number}: given {given}; allowed: a mapping with {', '.join(KEYS)}")
        elif _is_case(f"cases.{number}", one, KEYS, faults):
            yield id_, one


def _combined(factors: Any, faults: list[str]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Load cases of the mapping `product` in a file: all combinations of its factors' levels, ids joined by +."""
    if factors is None:
        return
    if (
        not isinstance(factors, Mapping)
        or not factors
        or not all(isinstance(one, Mapping) and one for one in factors.values())
    ):
        faults.append(f"product: given {show(factors)}; allowed: mappings of factors to levels by id")
        return
    count = 1
    for factor, levels in factors.items():
        count *= len(levels)
        for level, one in levels.items():
            if not _is_case(f"product.{factor}.{level}", one, OF_PRODUCT, faults):
                return
    if count > MOST:
        faults.append(f"product: given {count} combinations; allowed: at most {MOST}")
        return
    if twice := _given_twice(factors):
        faults.append(twice)
        return
    for combination in product(*(levels.items() for levels in factors.values())):
        merged: dict[str, Any] = {"set": {}, "load_cases": []}
        for _, one in combination:
            merged |= {key: value for key, value in one.items() if key in ALONE}
            merged["set"] |= one.get("set", {})
            merged["load_cases"] += one.get("load_cases", [])
        names = [str(one.get("name", level)) for level, one in combination]
        yield "+".join(str(level) for level, _ in combination), {**merged, "name": ", ".join(names)}


def _given_twice(factors: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """Error line about a key that two factors of a product both set; empty if none."""
    owner: dict[str, str] = {}
    for factor, levels in factors.items():
        keys = {key for one in levels.values() for key in ALONE if key in one}
        keys |= {f"set.{key}" for one in levels.values() for key in one.get("set", {})}
        for key in sorted(keys):
            if owner.setdefault(key, factor) != factor:
                return f"product.{factor}: given {key}, as in the levels of {owner[key]}; allowed: in one factor"
    return ""


def _is_name(given: Any) -> TypeGuard[str]:
    """Whether a value of a load case file is a printable text of one line, fit for an id or name."""
    return isinstance(given, str) and bool(given) and given.isprintable()


def _is_case(path: str, one: Any, keys: tuple[str, ...], faults: list[str]) -> bool:
    """Whether a value in a load case file is a valid entry of a case; if not, an error line is added to `faults`."""
    if not isinstance(one, Mapping):
        faults.append(f"{path}: given {show(one)}; allowed: a mapping with {', '.join(keys)}")
    elif unknown := [key for key in one if key not in keys]:
        faults.append(f"{path}.{unknown[0]}: this key does not exist; allowed: {', '.join(keys)}")
    elif not _is_name(one.get("name", "unnamed")):
        faults.append(f"{path}.name: given {show(one['name'])}; allowed: a text of one line")
    elif not isinstance(one.get("set", {}), Mapping):
        faults.append(f"{path}.set: given {show(one['set'])}; allowed: a mapping of dotted keys to values")
    elif not isinstance(one.get("load_cases", []), list):
        faults.append(f"{path}.load_cases: given {show(one['load_cases'])}; allowed: a list of PROFILE.LOAD_CASE")
    else:
        return True
    return False


def _each_vehicle(base: Scenario, id_: str, one: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Expand a load case with the loading plan `one` into a case for each vehicle; other cases stay as they are.

    The name of the vehicle is added to id and name. Of carriers with a search for the worst place, one stands for all.
    """
    if one.get("loading") != "one":
        yield id_, one
        return
    if "worst_place" in one and base.carriers is not None:
        yield id_, {**one, "vehicle": f"{base.carriers.name}_1"}
        return
    name = one.get("name", id_)
    for vehicle in _vehicles(base) or [""]:
        yield f"{id_}+{vehicle}", {**one, "name": f"{name}, {vehicle} full", "vehicle": vehicle}


def _worst_place(one: Mapping[str, Any], scenario: Scenario) -> WorstPlace | None:
    """Settings of the search for the worst place that a load case requests; None without a request."""
    if "worst_place" not in one:
        return None
    if "dynamic" in one:
        raise CaseError("worst_place: given together with dynamic; allowed: one of them, as a run has its own places")
    return read_worst_place(one["worst_place"], scenario, one=one.get("loading") == "one")


def _vehicles(scenario: Scenario) -> list[str]:
    """Names of the vehicles of a scenario that can have a payload."""
    return [name for name, one in scenario.vehicles.items() if one.payload is not None]


def _changes(base: Scenario, one: Mapping[str, Any]) -> dict[str, Any]:
    """Changes of a scenario for a load case, by dotted key: from loading, tensioning, `set` and `load_cases`."""
    plan = one.get("loading")
    values = {} if plan is None else loading(base, plan, one.get("vehicle"))
    values |= tensioning(base, one["tensioning"]) if "tensioning" in one else {}
    values |= {str(key): value for key, value in one.get("set", {}).items()}
    return values | ({"limits.load_cases": one["load_cases"]} if one.get("load_cases") else {})


def loading(scenario: Scenario, plan: Any, vehicle: str | None = None) -> dict[str, Any]:
    """Changes of a scenario's payloads for a loading plan, by dotted key.

    Args:
        scenario: scenario with payloads.
        plan: one of `PLANS`.
        vehicle: name of the full vehicle of the plan `one`.

    Raises:
        CaseError: there is no such plan, or no vehicle has a payload; one line.
    """
    if not isinstance(plan, str) or plan not in PLANS:
        raise CaseError(f"loading: given {show(plan)}; allowed: {', '.join(PLANS)}")
    first = next(iter(scenario.cables))
    chosen = _vehicles(scenario)
    if plan in ("every_second", "one"):
        chosen = chosen[::2] if plan == "every_second" else [name for name in chosen if name == vehicle]
    values: dict[str, Any] = {}
    for name, carriage in scenario.carriages.items():
        if carriage.payload is not None:
            here = {"up_full": scenario.rope_of(carriage) == first, "down_full": scenario.rope_of(carriage) != first}
            full = here.get(plan, plan != "empty") and name in chosen
            values[f"carriages.{name}.payload.mass"] = carriage.payload.capacity if full else 0.0
    carriers = scenario.carriers
    for path, kind in carriers.kinds_by_path.items() if carriers is not None else ():
        if kind.payload is None:
            continue
        key, most = ".".join((*path, "payload")), kind.payload.capacity
        up, down = (0.0 if plan in ("empty", which) else most for which in ("down_full", "up_full"))
        values[f"{key}.on_cable"] = None
        if scenario.sheaves:
            behind = scenario.strands[first].before if first in scenario.strands else ""
            values[f"{key}.leaving"] = {name: up if name == behind else down for name in scenario.sheaves}
            values |= {f"{key}.from_start": None, f"{key}.from_end": None}
        else:
            values |= {f"{key}.from_start": up, f"{key}.from_end": down}
    if carriers is not None and any(kind.payload for kind in carriers.kinds_by_path.values()):
        numbers = [n + 1 for n in range(carriers.count) if f"{carriers.name}_{n + 1}" in chosen]
        every = plan not in ("every_second", "one")
        values |= {} if every and carriers.loaded is None else {"carriers.loaded": None if every else numbers}
    if not values:
        raise CaseError(f"loading: given {plan!r}; allowed: {listed((), 'no plan, as no vehicle has a payload')}")
    return values
