"""Parameters of a calibration: keys of a scenario and errors of sensors, each with prior, bounds and unit."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

from cable_twin.basics.printable import printable
from cable_twin.basics.units import NORMAL_95, with_unit
from cable_twin.scenario import Scenario, ScenarioError, full_key, load_scenario, scenario_keys, value_at
from cable_twin.scenario.builders.system import tower_friction
from cable_twin.scenario.reference import WIND, explained, range_of
from cable_twin.simulation import Simulation
from cable_twin.simulation.same_model import OtherModelError

AXES = ("x", "y", "z")  # ends of keys of vectors
OF_SENSORS = "sensors"
ERRORS = ("bias", "gain", "delay")  # of a sensor
GAIN, DELAY = 0.01, 0.05  # -, s, prior standard deviations
BIAS = {"encoder": 0.05, "inclinometer": 0.005}  # m, rad; of others a share of the load at rest, or of the limit
BIAS_SHARE = 0.01
LONGEST_DELAY = 1.0  # s
SHARE, WIDEST, NARROWEST = 0.2, 6.0, 0.02  # prior deviation over value; bounds in deviations above, as share below
# prior standard deviation by the end of a key: share of the value, or a value where the unit is given; all assumed
SHARES = (
    (r"(\.|_)stiffness$", 0.15),
    (r"\.mass_per_length$", 0.05),
    (r"\.(start|end|counterweight)\.mass$", 0.03),
    (r"\.(mass|inertia)$", 0.1),
    (r"friction|resistance", 0.5),
    (r"damping", 0.75),
    (r"\.drag", 0.3),
)
OF_CAPACITY = 0.3  # prior standard deviation of a payload
PAYLOAD = re.compile(r"(.*\.payload)\.(mass|from_start|from_end|on_cable|leaving\.[^.]+)")
TOWER_FRICTION = re.compile(r"towers\.([^.]+)\.friction")
ABSOLUTE = ((r"^air\.wind\.", 5.0), (r"temperature$", 15.0), (r"\.ice", 1.0))


class CalibrationError(ValueError):
    """Error of an input that the command `calibrate` cannot use; the message is one line."""


class Parameter(NamedTuple):
    """Free parameter of a calibration: key, unit, prior and bounds."""

    key: str
    unit: str
    mean: float
    deviation: float
    low: float
    high: float
    sensor: str = ""  # whose error it is; empty for a key of the scenario
    error: str = ""  # of `ERRORS`
    given: bool = False  # whether its prior is given by the user
    joined: tuple[str, ...] = ()  # keys of other strands of the loop, or of a tower's other ropes, of the same value

    @property
    def keys(self) -> tuple[str, ...]:
        """All scenario keys that have the value of the parameter; of a sensor's error its key."""
        return (self.key, *self.joined)

    @property
    def prior(self) -> str:
        """Prior of the parameter as text: mean +- half of its 95 % interval, with unit."""
        return f"{with_unit(self.mean, self.unit)} +- {with_unit(NORMAL_95 * self.deviation, self.unit, 3)}"


class Prior(NamedTuple):
    """Prior of a parameter, given by the user: mean and standard deviation."""

    mean: float
    deviation: float


def prior_of(text: str) -> tuple[str, Prior]:
    """Parse a prior given as KEY=VALUE:DEVIATION into the parameter's full key and the prior.

    Raises:
        ValueError: one line with the given text and the allowed form.
    """
    key, _, numbers = text.partition("=")
    try:
        mean, deviation = (float(part) for part in numbers.split(":"))
    except ValueError:
        mean = deviation = math.nan
    if not key.strip() or not math.isfinite(mean) or not 0.0 < deviation < math.inf:
        raise ValueError(
            f"given {printable(text)!r}; allowed: KEY=VALUE:DEVIATION, finite and the deviation above 0, "
            "as in air.wind.x=0:5"
        )
    return full_key(key.strip()), Prior(mean, deviation)


def parameters_of(
    simulation: Simulation, keys: Sequence[str], priors: Mapping[str, Prior], scale: Mapping[str, float]
) -> tuple[Parameter, ...]:
    """Free parameters of a calibration from their keys; keys of sensor errors may contain the wildcard *.

    Args:
        simulation: of the twin at rest.
        keys: dotted keys; `sensors.NAME.bias`, `.gain` and `.delay` are errors of sensors.
        priors: priors given by the user, by key.
        scale: typical size of each sensor's readings, by its name.

    Returns:
        One for each key, but one alone for a property of the rope that all strands of a loop are, and for a key of a
        tower of several ropes.

    Raises:
        CalibrationError: a key does not exist or cannot be free; one line.
    """
    scenario = simulation.scenario
    resolved = scenario.resolved()
    priors = {scenario_keys(resolved, key)[0]: prior for key, prior in priors.items()}
    found: dict[str, Parameter] = {}
    freed: set[str] = set()  # with joined keys
    for given in keys:
        key, *alike = scenario_keys(resolved, given)
        if key in freed and key not in found:
            continue  # of a strand whose loop is free already
        if key.startswith(f"{OF_SENSORS}.") and key.rpartition(".")[2] in ERRORS:
            own = _errors_of(scenario, key, priors, scale)
        else:
            own = [_of_scenario(simulation, key, alike, priors, given)]
        for one in own:
            if twice := freed.intersection(one.keys):
                raise CalibrationError(f"--free: given {min(twice)} twice; allowed: once")
            found[one.key] = one
            freed.update(one.keys)
    for key in priors:
        if key not in freed:
            raise CalibrationError(f"--prior: given {printable(key)}; allowed: a key given in --free")
    return tuple(found.values())


def _joined(scenario: Scenario, key: str) -> tuple[str, ...]:
    """Keys of the other strands of a loop that have the value of one strand's key, as all are one rope."""
    section, _, rest = key.partition(".")
    rope, _, name = rest.partition(".")
    strands = scenario.strands
    if section != "ropes" or rope not in strands or name in ("", "lateral"):
        return ()
    loop, here = [], rope
    while (here := scenario.sheaves[strands[here].after].ropes[1]) != rope:
        loop.append(f"ropes.{here}.{name}")
    resolved = scenario.resolved()
    return tuple(one for one in loop if value_at(resolved, one) == value_at(resolved, key))


def _errors_of(
    scenario: Scenario, key: str, priors: Mapping[str, Prior], scale: Mapping[str, float]
) -> list[Parameter]:
    """Free parameters for an error (bias, gain or delay) of each sensor whose name matches the wildcard in a key."""
    _, _, rest = key.partition(".")
    pattern, _, error = rest.rpartition(".")
    names = [name for name in scenario.sensors if fnmatchcase(name, pattern) and name in scale]
    if not names:
        raise CalibrationError(f"--free: given sensor '{printable(pattern)}'; allowed: {', '.join(scale)}")
    found = []
    for name in names:
        own, kind = f"{OF_SENSORS}.{name}.{error}", scenario.sensors[name].kind
        unit = {"encoder": "m", "inclinometer": "rad"}.get(kind, "N")
        usual = BIAS.get(kind, BIAS_SHARE * scale[name]) if error == "bias" else GAIN if error == "gain" else DELAY
        mean, deviation = priors.get(own, Prior(0.0, usual))
        most = LONGEST_DELAY if error == "delay" else WIDEST * deviation
        unit = unit if error == "bias" else "-" if error == "gain" else "s"
        found.append(Parameter(own, unit, mean, deviation, mean - most, mean + most, name, error, given=own in priors))
    return found


def _of_scenario(
    simulation: Simulation, key: str, alike: Sequence[str], priors: Mapping[str, Prior], given: str
) -> Parameter:
    """Free parameter for a key of the scenario, and of joined strands or of a tower's other ropes, `alike`.

    In messages the key is as the user gave it.
    """
    scenario = simulation.scenario
    above, _, last = key.rpartition(".")
    try:
        entries = explained(above if last in AXES or last.isdecimal() else key)
    except KeyError as error:
        raise CalibrationError(f"--free: {error.args[0]}") from None
    resolved = scenario.resolved()
    value = _value(scenario, resolved, key)
    if value is None or isinstance(value, bool | str) or not isinstance(value, int | float):
        raise CalibrationError(f"--free: {printable(given)}: {_no_number(resolved, key, value, given)}")
    if isinstance(value, int) and not isinstance(value, bool) and "whole" in entries[0].allowed:
        raise CalibrationError(f"--free: {key}: given a key of whole numbers; allowed: keys that take any number")
    for one in alike:
        if _value(scenario, resolved, one) != value:
            raise CalibrationError(
                f"--free: given {key} and {one} as one parameter, of different values; allowed: each for itself"
            )
    joined = (*alike, *_joined(scenario, key))
    if len(given_priors := [one for one in (key, *joined) if one in priors]) > 1:
        of = "tower" if alike else "rope"
        raise CalibrationError(f"--prior: given {' and '.join(given_priors)}, of one {of}; allowed: one of them")
    prior = priors[given_priors[0]] if given_priors else None
    if prior is None and value == 0.0 and not _absolute(key) and not PAYLOAD.fullmatch(key):
        raise CalibrationError(
            f"--free: {key}: given 0 in the scenario, from which no prior follows; allowed: with --prior "
            f"{key}=0:DEVIATION"
        )
    mean, deviation = (float(value), _usual(key, float(value), resolved)) if prior is None else prior
    low, high = _bounds(key, mean, deviation, resolved)
    unit = entries[0].unit if len(entries) == 1 else "-"
    if not low <= mean <= high:
        name = "--free" if prior is None else "--prior"
        least, most = _range(key, mean, resolved)
        allowed = " and ".join(
            f"{words} {with_unit(end, unit or '-')}"
            for words, end in (("at least", least), ("at most", most))
            if math.isfinite(end)
        )
        raise CalibrationError(f"{name}: {key}: given a mean of {with_unit(mean, unit or '-')}; allowed: {allowed}")
    parameter = Parameter(key, unit or "-", mean, deviation, low, high, given=prior is not None, joined=joined)
    _try_free(simulation, parameter, mean + (0.1 if mean + 0.1 * deviation <= high else -0.1) * deviation)
    for end in (low, high):
        _try_value(scenario, parameter, end)
    return parameter


def _value(scenario: Scenario, resolved: Mapping[str, Any], key: str) -> Any:
    """Value of a scenario key; of the friction of a tower without one the usual one of its kind."""
    value = value_at(resolved, key)
    if value is None and (tower := TOWER_FRICTION.fullmatch(key)) and tower[1] in scenario.towers:
        return tower_friction(scenario.towers[tower[1]])
    return value


def _no_number(resolved: Mapping[str, Any], key: str, value: Any, given: str) -> str:
    """Words about a key without a number as value, and what is allowed in its place."""
    if isinstance(value, Mapping | list | tuple):
        return "given a section; allowed: keys with a number as value"
    above, _, last = key.rpartition(".")
    section = value_at(resolved, above)
    if value is None and isinstance(section, Mapping) and last in section:
        return f"given null in this scenario; allowed: with --set {printable(given)}=VALUE, the mean of its prior"
    return "given no number in this scenario; allowed: keys with a number as value"


def _usual(key: str, value: float, resolved: Mapping[str, Any]) -> float:
    """Default standard deviation of the prior of a scenario key, from the kind of key and its value."""
    if (absolute := _absolute(key)) is not None:
        return absolute
    if payload := PAYLOAD.fullmatch(key):
        return OF_CAPACITY * _capacity(payload[1], resolved)
    return next((share for pattern, share in SHARES if re.search(pattern, key)), SHARE) * abs(value)


def _capacity(payload: str, resolved: Mapping[str, Any]) -> float:
    """Capacity (kg) of a payload by the dotted key of its section."""
    return float(value_at(resolved, f"{payload}.capacity"))


def _absolute(key: str) -> float | None:
    return next((value for pattern, value in ABSOLUTE if re.search(pattern, key)), None)


def _bounds(key: str, mean: float, deviation: float, resolved: Mapping[str, Any]) -> tuple[float, float]:
    """Bounds of a free scenario key about its prior mean: for most keys of one sign; within the range of the key."""
    least, most = _range(key, mean, resolved)
    if PAYLOAD.fullmatch(key):
        return least, most
    low, high = mean - WIDEST * deviation, mean + WIDEST * deviation
    if _absolute(key) is None:
        low, high = (max(low, NARROWEST * mean), high) if mean >= 0.0 else (low, min(high, NARROWEST * mean))
    return max(low, least), min(high, most)


def _range(key: str, mean: float, resolved: Mapping[str, Any]) -> tuple[float, float]:
    """Values that a scenario key can take: of a payload 0 to its capacity, of a wind as long as it is not too strong.

    Of a range without its end, such as numbers above 0, the end is a little inside, towards the mean.
    """
    if payload := PAYLOAD.fullmatch(key):
        return 0.0, _capacity(payload[1], resolved)
    own = range_of(key)
    if WIND.fullmatch(key):
        wind = [float(one) for one in value_at(resolved, "air.wind")]
        others = math.hypot(*wind) ** 2 - float(value_at(resolved, key)) ** 2
        most = math.sqrt(max(own.high**2 - others, 0.0))
        return -most, most
    low = own.low + NARROWEST * max(mean - own.low, 0.0) if own.without_low else own.low
    high = own.high - NARROWEST * max(own.high - mean, 0.0) if own.without_high else own.high
    return low, high


def _try_value(scenario: Scenario, parameter: Parameter, value: float) -> None:
    """Raise an error if a scenario is not valid with a parameter set to a bound of the calibration."""
    try:
        load_scenario(scenario.resolved(), dict.fromkeys(parameter.keys, value))
    except ScenarioError as error:
        raise CalibrationError(
            f"--free: {parameter.key}: given a prior that reaches {value:.6g}: {str(error).splitlines()[0]}; allowed: "
            "a narrower --prior"
        ) from None


def _try_free(simulation: Simulation, parameter: Parameter, value: float) -> None:
    """Raise an error if changing a parameter in a calibration needs another mesh, other parts or another solver."""
    key, resolved = parameter.key, simulation.scenario.resolved()
    try:
        other = load_scenario(resolved, dict.fromkeys(parameter.keys, value))
        simulation.with_values(other, rest=False)
        simulation.engine.go_to_start()
    except OtherModelError as error:
        raise CalibrationError(
            f"--free: {key} needs {error}; allowed: keys that leave ropes, meshes, vehicles, supports and the solver "
            "as they are, such as masses, payloads, stiffnesses, damping, friction, drag, wind and ice"
        ) from None
    except ScenarioError as error:
        raise CalibrationError(f"--free: {key}: {str(error).splitlines()[0]}") from None
