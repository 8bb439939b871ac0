"""Prediction of measurements by an ensemble of twins: residuals at a point in parameter space, and their Jacobian."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from cable_twin.basics.units import with_unit
from cable_twin.ensemble import Ensemble
from cable_twin.ensemble.estimate.quantities import QUANTISED, Reading
from cable_twin.frame.records import AppliedCommand, FloatArray
from cable_twin.frame.sensors import UNLIMITED
from cable_twin.frame.snapshot import Snapshot
from cable_twin.offline.calibration.data import Package, Series
from cable_twin.offline.calibration.parameters import CalibrationError, Parameter
from cable_twin.scenario import Scenario, command_limits, load_scenario
from cable_twin.simulation import EquilibriumError

APART = 0.03  # prior standard deviations between the members of a difference
SAME_TIME = 1e-6  # s
FINEST = {"encoder": 1e-3, "inclinometer": 2.5e-4}  # m, rad: least standard deviation of a sensor, assumed
FINEST_SHARE = 1e-4  # the same of others, of the load at rest or of the limit of the drive


class Evaluation(NamedTuple):
    """Residuals at one point in parameter space, in standard deviations of the sensors, with their Jacobian."""

    point: FloatArray  # (n,) of the parameters, in deviations of their priors from the mean
    residuals: FloatArray  # (rows,) of all measurements, those held out included
    jacobian: FloatArray  # (rows, n)
    fresh: bool = True  # whether the Jacobian is of this point, else of one nearby


class Rows(NamedTuple):
    """Log, sensor and time of each residual of a calibration, and whether the residual is held out."""

    log: NDArray[np.int64]
    sensor: NDArray[np.int64]  # number among `sensors`
    time: FloatArray  # s
    held: NDArray[np.bool_]
    sensors: tuple[str, ...]


def scales_of(scenario: Scenario, rest: Snapshot) -> dict[str, float]:
    """Typical size of each sensor's readings: load at rest (N), force limit of a drive (N), or 1 (m, rad)."""
    rows, limits, found = rest.layout.support_rows, command_limits(scenario), {}
    for name, sensor in scenario.sensors.items():
        if sensor.kind == "load_cell":
            found[name] = float(np.linalg.norm(rest.columns.support_force[rows[sensor.of]]))
        elif sensor.kind == "drive_force":
            most = limits[sensor.of].force if sensor.of in limits else 0.0
            found[name] = most if np.isfinite(most) and most > 0.0 else UNLIMITED
        elif sensor.kind in FINEST:
            found[name] = 1.0
    return found


def deviations_of(scenario: Scenario, scales: Mapping[str, float]) -> dict[str, float]:
    """Standard deviation of each sensor's samples: root sum square of noise, quantisation and a minimum deviation."""
    found = {}
    for name, scale in scales.items():
        sensor = scenario.sensors[name]
        least = FINEST.get(sensor.kind, FINEST_SHARE * scale)
        found[name] = float(np.sqrt(sensor.noise**2 + (QUANTISED * sensor.quantum) ** 2 + least**2))
    return found


MUCH_MORE = 1.5  # times as long


class Predictor:
    """Predictor of logged measurements: an ensemble of twins repeats the logged runs with varied parameters.

    Args:
        scenario: of the twin, with sensors.
        packages: data of each log.
        readings: of sensors by name.
        deviations: standard deviation of a sample of each sensor, by its name.
        parameters: free parameters.
        threads: of the ensemble.
    """

    def __init__(
        self,
        scenario: Scenario,
        packages: Sequence[Package],
        readings: Mapping[str, Reading],
        deviations: Mapping[str, float],
        parameters: Sequence[Parameter],
        threads: int | None = None,
    ) -> None:
        self._scenario, self._packages, self._readings = scenario, packages, readings
        self.parameters, self._deviations, self._threads = tuple(parameters), deviations, threads
        self._mean, self._spread = (
            np.array([getattr(one, name) for one in parameters]) for name in ("mean", "deviation")
        )
        self._low, self._high = (np.array([getattr(one, name) for one in parameters]) for name in ("low", "high"))
        self._of_model = [number for number, one in enumerate(parameters) if not one.sensor]
        self._known: dict[str, Evaluation] = {}
        self.on_evaluation: Callable[[Evaluation], object] = lambda _: None
        self.bar: Callable[[int], AbstractContextManager[Callable[[float], object]]] = lambda _: nullcontext(_nothing)
        names = tuple(readings)
        of_series = [(log, series) for log, one in enumerate(packages) for series in one.series]
        self.rows = Rows(
            np.concatenate([np.full(one.times.size, log) for log, one in of_series]),
            np.concatenate([np.full(one.times.size, names.index(one.sensor)) for _, one in of_series]),
            np.concatenate([one.times for _, one in of_series]),
            np.concatenate([one.held for _, one in of_series]),
            names,
        )

    def first(self, seconds: float) -> Predictor | None:
        """Predictor for only the first seconds (s) of each log; None where no log is much longer."""
        if max(one.end for one in self._packages) < MUCH_MORE * seconds:
            return None
        packages = [one.first(seconds) for one in self._packages]
        short = Predictor(
            self._scenario, packages, self._readings, self._deviations, self.parameters, threads=self._threads
        )
        short.bar = self.bar
        return short

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the parameters, as offsets from the prior means in prior standard deviations."""
        return (self._low - self._mean) / self._spread, (self._high - self._mean) / self._spread

    def values(self, point: FloatArray) -> FloatArray:
        """Parameter values, in their units, at a point of offsets from the prior means in prior standard deviations."""
        found: FloatArray = np.clip(self._mean + self._spread * point, self._low, self._high)
        return found

    def remember(self, evaluation: Evaluation) -> None:
        """Keep an evaluation of an earlier calibration, so that its point is not evaluated again."""
        self._known[_name(evaluation.point)] = evaluation

    @property
    def evaluations(self) -> tuple[Evaluation, ...]:
        """All evaluations of residuals and Jacobians so far."""
        return tuple(self._known.values())

    def evaluate(self, point: FloatArray, near: Evaluation | None = None) -> Evaluation:
        """Evaluate residuals and Jacobian at a point by an ensemble: one member there, one perturbed per scenario key.

        Args:
            point: of the parameters, in deviations of their priors from the mean.
            near: evaluation of a point so near that its Jacobian is used; one member is enough then.

        Raises:
            CalibrationError: a member failed.
            EquilibriumError: a member has no equilibrium.
        """
        name = _name(point)
        if (kept := self._known.get(name)) is not None and (kept.fresh or near is not None):
            return kept
        beside, steps = self._beside(point) if near is None else (np.empty((0, point.size)), np.empty(0))
        members = np.vstack([point, beside])
        values = np.array([self.values(one) for one in members])
        predicted: list[FloatArray] = []
        duration, before = sum(one.end for one in self._packages), 0.0
        with self.bar(len(self._known) + 1) as share:
            for package in self._packages:
                predicted += self._run(package, values, partial(_share_after, share, before, duration))
                before += package.end
        found = self._linear(point, predicted, steps, near)
        self._known[name] = found
        self.on_evaluation(found)
        return found

    def look(self, points: FloatArray) -> FloatArray:
        """Residuals alone at several points, by an ensemble of one member each; nothing of it is kept.

        Args:
            points: (m, n) of n parameters, in deviations of their priors from the mean.

        Returns:
            Residuals (rows, m) in standard deviations of the sensors; infinite where the twin has no rest or fails.
        """
        values = np.array([self.values(one) for one in points])
        predicted: list[FloatArray] = []
        lost: set[int] = set()
        duration, before = sum(one.end for one in self._packages), 0.0
        try:
            with self.bar(len(self._known) + 1) as share:
                for package in self._packages:
                    predicted += self._run(package, values, partial(_share_after, share, before, duration), lost)
                    before += package.end
        except EquilibriumError:
            if len(points) == 1:
                return np.full((self.rows.time.size, 1), np.inf)
            middle = len(points) // 2  # one of them has no rest: it is searched for by halves
            return np.hstack([self.look(points[:middle]), self.look(points[middle:])])
        every, found = [series for one in self._packages for series in one.series], []
        for series, of_members in zip(every, predicted, strict=True):
            for number, own in enumerate(values):
                seen, _ = self._seen(series, of_members[:, number : number + 1], own)
                of_members[:, number] = (series.values - seen[:, 0]) / self._deviations[series.sensor]
            found.append(of_members)
        residuals = np.vstack(found)
        residuals[:, sorted(lost)] = np.inf
        return residuals

    def ratios(self, evaluation: Evaluation) -> dict[str, float]:
        """Ratio, per sensor, of the median size of its readings to the median size of the twin's predictions."""
        found, first = {}, 0
        for series in (series for one in self._packages for series in one.series):
            own = slice(first, first + series.times.size)
            predicted = series.values - evaluation.residuals[own] * self._deviations[series.sensor]
            sizes = [float(np.median(np.abs(values))) for values in (series.values, predicted)]
            if min(sizes) > 3.0 * self._deviations[series.sensor]:
                found[series.sensor] = sizes[0] / sizes[1]
            first += series.times.size
        return found

    def _beside(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (n, parameters) for finite differences, each with one of n scenario keys perturbed, and steps (n,)."""
        low, high = self.bounds
        beside = np.tile(point, (len(self._of_model), 1))
        steps = np.empty(len(self._of_model))
        for row, number in enumerate(self._of_model):
            up = point[number] + APART <= high[number]
            steps[row] = APART if up else -APART
            beside[row, number] = np.clip(point[number] + steps[row], low[number], high[number])
            steps[row] = beside[row, number] - point[number]
        return beside, steps

    def _run(
        self, package: Package, values: FloatArray, share: Callable[[float], object], lost: set[int] | None = None
    ) -> list[FloatArray]:
        """Run an ensemble over a log; returns predictions (samples, members) for each time series of the log.

        A member that fails ends the run with an error, or with `lost` is noted there.
        """
        keys = {key: number for number in self._of_model for key in self.parameters[number].keys}
        middle = load_scenario(self._scenario.resolved(), {key: float(values[0, row]) for key, row in keys.items()})
        parameters: dict[str, Any] = {key: values[:, row].tolist() for key, row in keys.items()}
        ensemble = Ensemble(middle, len(values), parameters=parameters, threads=self._threads, progress=False)
        try:
            return self._sampled(ensemble, package, values, share, lost)
        finally:
            ensemble.close()

    def _sampled(
        self,
        ensemble: Ensemble,
        package: Package,
        values: FloatArray,
        share: Callable[[float], object],
        lost: set[int] | None,
    ) -> list[FloatArray]:
        step = ensemble.scenario.solver.step
        due: dict[int, list[AppliedCommand]] = {}
        for applied in package.commands:
            due.setdefault(round(applied.time / step), []).append(applied)
        wanted: dict[int, list[tuple[int, int]]] = {}
        for number, series in enumerate(package.series):
            for row, clock in enumerate(np.round(series.times / step).astype(int).tolist()):
                wanted.setdefault(clock, []).append((number, row))
        found = [np.empty((one.times.size, len(values))) for one in package.series]
        last = max(wanted)
        for clock in sorted({*due, *wanted}):
            if clock > last:
                break
            ensemble.advance_to(clock * step)
            if ensemble.faults:
                if lost is None:
                    raise self._fault(ensemble, package, values)
                lost.update(ensemble.faults)
                if len(lost) == len(values):
                    break
            if clock in wanted:  # a command acts after what is measured at its time
                numbers = ensemble.numbers()
                for number, row in wanted[clock]:
                    found[number][row] = self._readings[package.series[number].sensor].of(numbers)
            for applied in due.get(clock, ()):
                ensemble.apply(applied.command)
            share(clock * step)
        for rows in found:
            rows[:, sorted(lost or ())] = 0.0
        return [_at(one.times, step, rows) for one, rows in zip(package.series, found, strict=True)]

    def _fault(self, ensemble: Ensemble, package: Package, values: FloatArray) -> CalibrationError:
        member, fault = next(iter(ensemble.faults.items()))
        given = ", ".join(
            f"{one.key} {with_unit(value, one.unit)}"
            for one, value in zip(self.parameters, values[member], strict=True)
            if not one.sensor
        )
        return CalibrationError(f"{package.path}: the twin failed with {given}: {fault}")

    def _linear(
        self, point: FloatArray, predicted: Sequence[FloatArray], steps: FloatArray, near: Evaluation | None
    ) -> Evaluation:
        """Residuals and Jacobian, scaled by sensor and prior standard deviations, from the ensemble's predictions."""
        values, residuals, slopes = self.values(point), [], []
        every = [series for one in self._packages for series in one.series]
        for series, of_members in zip(every, predicted, strict=True):
            seen, along = self._seen(series, of_members, values)
            deviation = self._deviations[series.sensor]
            residuals.append((series.values - seen[:, 0]) / deviation)
            if near is not None:
                continue
            rows = np.zeros((series.times.size, len(self.parameters)))
            rows[:, self._of_model] = -(seen[:, 1:] - seen[:, :1]) / steps / deviation
            for number, slope in along.items():
                rows[:, number] = -slope * self._spread[number] / deviation
            slopes.append(rows)
        jacobian = np.vstack(slopes) if near is None else near.jacobian
        return Evaluation(np.array(point, dtype=float), np.concatenate(residuals), jacobian, near is None)

    def _seen(
        self, series: Series, of_members: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, dict[int, FloatArray]]:
        """Predicted readings (samples, members) with sensor errors added, and derivatives (samples,) by each error."""
        errors = {one.error: row for row, one in enumerate(self.parameters) if one.sensor == series.sensor}
        along: dict[int, FloatArray] = {}
        if "delay" in errors:
            spline = CubicSpline(series.times, of_members, axis=0)
            when = np.clip(series.times - values[errors["delay"]], series.times[0], series.times[-1])
            of_members = spline(when)
            along[errors["delay"]] = -spline(when, 1)[:, 0]
        seen = of_members.copy()
        if "gain" in errors:
            seen *= 1.0 + values[errors["gain"]]
            along[errors["gain"]] = of_members[:, 0]
        if "bias" in errors:
            seen += values[errors["bias"]]
            along[errors["bias"]] = np.ones(series.times.size)
        return seen, along


def _at(times: FloatArray, step: float, rows: FloatArray) -> FloatArray:
    """Interpolate predictions from solver steps to the exact sample times by a cubic spline."""
    steps = np.round(times / step) * step
    if np.abs(times - steps).max() < SAME_TIME or times.size < 4:
        return rows
    own, first = np.unique(np.round(times / step), return_index=True)
    found: FloatArray = CubicSpline(own * step, rows[first], axis=0)(times)
    return found


def _share_after(share: Callable[[float], object], before: float, duration: float, time: float) -> None:
    share((before + time) / duration)


def _nothing(_share: float) -> None:
    """Progress callback of an evaluation that does nothing, for callers that show no progress."""


def _name(point: FloatArray) -> str:
    return hashlib.sha256(np.ascontiguousarray(point, dtype=float).tobytes()).hexdigest()


def load_state(path: Path, fingerprint: str) -> list[Evaluation]:
    """Load the evaluations of an earlier calibration with equal inputs; an empty list without such a file."""
    try:
        with np.load(path, allow_pickle=False) as kept:
            if str(kept["fingerprint"]) != fingerprint:
                return []
            columns = [kept[name] for name in ("points", "residuals", "jacobians", "fresh")]
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return []
    return [Evaluation(point, one, slopes, bool(fresh)) for point, one, slopes, fresh in zip(*columns, strict=True)]


def save_state(path: Path, fingerprint: str, evaluations: Sequence[Evaluation]) -> None:
    """Save all evaluations of a calibration so far, replacing the file atomically.

    Raises:
        OSError: the disk refuses.
    """
    points, residuals, jacobians, fresh = (np.array(column) for column in zip(*evaluations, strict=True))
    part = path.with_suffix(".part")
    with part.open("wb") as file:
        np.savez(file, fingerprint=fingerprint, points=points, residuals=residuals, jacobians=jacobians, fresh=fresh)
    part.replace(path)
