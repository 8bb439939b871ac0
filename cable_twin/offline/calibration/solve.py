"""Bounded least squares over the identifiable parameters of a calibration, and intervals of the estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from cable_twin.basics.units import NORMAL_95, counted, rounded
from cable_twin.frame.records import FloatArray
from cable_twin.offline.calibration.check import Check, covariance_of
from cable_twin.offline.calibration.data import STRETCH
from cable_twin.offline.calibration.parameters import CalibrationError, Parameter
from cable_twin.offline.calibration.prediction import Evaluation, Predictor, Rows
from cable_twin.offline.calibration.starts import starting_points
from cable_twin.simulation import EquilibriumError

HORIZONS = 60.0, 180.0  # s, first parts of long logs that are searched before
SLOW, MOST_ROUGH = 10.0, 3  # s, evaluations: of the first, rough search
NEAR = 3.0  # standard deviations of what is found, within which a Jacobian is kept
NO_STEP = 0.03  # standard deviations of what is found, below which a step counts nothing
NO_LONGER_SMOOTH = 0.3  # the same of a step that makes it worse
NO_GAIN = 0.005  # of the cost
LEAST_DAMPING = 1e-3  # of the diagonal of the normal matrix
LEAST_AFTER_FAILURE = 0.1  # the same where the twin could not take the step
MOST_EVALUATIONS, MOST_FAILED = 25, 6
AT_BOUND = 1e-3  # prior deviations
MISFIT = 1.5  # root mean square of residuals from which on a sensor does not fit
MOST_ELSEWHERE = 10  # evaluations from another start on the first part of the logs; in the right valley 3 to 6 do
OF_EACH, ROUNDS = 2, 2  # starting points of each kind from which the search starts again, looks for such points
LOWER = 0.95  # of the cost, which another start has to reach on the first part of the logs
FEWEST_CLUSTERS = 5


class Estimate(NamedTuple):
    """Estimate of a parameter with its 95 % interval; one that the data do not identify keeps its prior."""

    parameter: Parameter
    value: float
    deviation: float
    told: bool
    at_bound: bool
    inflated: float  # factor on the deviation for the error of the model that shows in the residuals

    @property
    def half(self) -> float:
        """Half of the width of the 95 % interval of the estimate, before it is cut at bounds."""
        return NORMAL_95 * self.deviation

    @property
    def low(self) -> float:
        """Lower end of the 95 % interval, cut at the bound of the parameter; in its unit."""
        return max(self.value - self.half, min(self.parameter.low, self.value))

    @property
    def high(self) -> float:
        """Upper end of the 95 % interval, cut at the bound of the parameter; in its unit."""
        return min(self.value + self.half, max(self.parameter.high, self.value))

    @property
    def cut(self) -> bool:
        """Whether the 95 % interval reaches beyond a bound of the parameter, at which it is cut."""
        return self.low > self.value - self.half or self.high < self.value + self.half


class Fit(NamedTuple):
    """Fit of one sensor: root mean square of its residuals, in its standard deviations."""

    sensor: str
    before: float  # training, at the priors
    after: float  # training
    held: float  # validation; NaN without any
    samples: int


class Solution(NamedTuple):
    """Result of a calibration: estimates, correlations, fits of all sensors, first and last evaluation."""

    estimates: tuple[Estimate, ...]
    correlation: FloatArray  # (n, n); of untold ones 0
    fits: tuple[Fit, ...]
    prior: Evaluation
    last: Evaluation
    converged: bool  # whether the search came to an end
    evaluations: int
    starts: int  # points from which it began

    @property
    def misfits(self) -> tuple[Fit, ...]:
        """Fits of the sensors whose residuals are larger than their deviations explain: the model does not fit them."""
        return tuple(one for one in self.fits if one.after > MISFIT)

    @property
    def done(self) -> bool:
        """Whether the calibration is a success: the search came to an end at which all sensors fit."""
        return self.converged and not self.misfits


def solve(
    predictor: Predictor, check: Check, prior: Evaluation, say: Callable[[str], object] = lambda _: None
) -> Solution:
    """Solve a calibration: bounded least squares of training data and priors.

    Where the sensors do not fit at the end, the search starts again from other points, and the best end is kept.

    Args:
        predictor: of the measurements.
        check: identifiability check; parameters that are not identifiable keep their priors.
        prior: evaluation at the means of the priors.
        say: called with a line where the search starts again.

    Raises:
        CalibrationError: the twin failed.
    """
    told, starts = check.told, 1
    if not told:
        return _solution(predictor, told, prior, prior, converged=True, starts=starts)

    # of a long run phases of swings fit nowhere but near what is to be found
    shorts = [short for seconds in HORIZONS if (short := predictor.first(seconds)) is not None]
    failure: EquilibriumError | CalibrationError | None = None
    try:
        at, converged = _descent(predictor, shorts, told, prior.point)
    except (EquilibriumError, CalibrationError) as error:  # no step from where it was leads to a rest
        at, converged, failure = prior, False, error
    for _ in range(ROUNDS):
        if not (misfits := [one for one in _fits(predictor.rows, prior, at) if one.after > MISFIT]):
            break
        worst = max(misfits, key=lambda one: one.after)
        say(
            f"{counted(len(misfits), 'sensor')} beyond {MISFIT} standard deviations at the end of the search "
            f"({worst.sensor} {rounded(worst.after, 3)}): it starts again from elsewhere"
        )
        better, tried = _from_elsewhere(predictor, shorts, told, prior, at)
        starts += tried
        if better is None:
            break
        (at, converged), failure = better, None
    if failure is not None:
        raise failure
    return _solution(predictor, told, prior, at, converged=converged, starts=starts)


def _descent(
    predictor: Predictor, shorts: Sequence[Predictor], told: Sequence[int], point: FloatArray
) -> tuple[Evaluation, bool]:
    """Search the first parts of long logs, then all, from a point on; returns best evaluation, whether converged."""
    for short in shorts:
        point = _from_here(short, told, short.evaluate(point))[0].point
    return _from_here(predictor, told, predictor.evaluate(point))


def _from_elsewhere(
    predictor: Predictor, shorts: Sequence[Predictor], told: Sequence[int], prior: Evaluation, at: Evaluation
) -> tuple[tuple[Evaluation, bool] | None, int]:
    """Search from the best of other starting points; returns a better end, if there is one, and the number of starts.

    A coarse look tells the best: residuals at all points, averaged, without Jacobians, of the first part of long logs.
    A start whose end is no better there is not searched further.
    """
    kinds = starting_points(predictor.parameters, told, predictor.bounds, at.point)
    rough, points = (shorts[0] if shorts else predictor), np.vstack([at.point, *kinds])
    if len(points) == 1:
        return None, 0
    looked, means, fine = rough.look(points), Means(rough.rows, SLOW), Means(rough.rows, 0.0)
    evaluations = [at._replace(point=point, residuals=own) for point, own in zip(points, looked.T, strict=True)]
    costs, here = [cost(one, means) for one in evaluations], cost(evaluations[0], fine)
    near = range(1, 1 + len(kinds[0]))
    chosen = [
        row
        for kind in (near, range(near.stop, len(points)))
        for row in sorted((row for row in kind if np.isfinite(costs[row])), key=costs.__getitem__)[:OF_EACH]
    ]
    every, best, tried = Means(predictor.rows, 0.0), None, 0
    lowest = cost(at, every)
    for row in sorted(chosen, key=costs.__getitem__):
        point, tried = points[row], tried + 1
        try:
            if shorts:
                begun, _ = _from_here(rough, told, rough.evaluate(point), MOST_ELSEWHERE)
                if cost(begun, fine) > LOWER * here:
                    continue
                point = begun.point
            found = _descent(predictor, shorts[1:], told, point)
        except (EquilibriumError, CalibrationError):  # no rest there, or the twin failed
            continue
        if (reached := cost(found[0], every)) < lowest:
            best, lowest = found, reached
            if not any(one.after > MISFIT for one in _fits(predictor.rows, prior, found[0])):
                break
    return best, tried


def _from_here(
    predictor: Predictor, told: Sequence[int], at: Evaluation, most: int = MOST_EVALUATIONS
) -> tuple[Evaluation, bool]:
    """Minimise the calibration cost of averaged, then of all residuals; returns best evaluation, whether converged."""
    rows = predictor.rows
    at, _ = _search(predictor, told, at, Means(rows, SLOW), roughly=True)
    return _search(predictor, told, at, Means(rows, 0.0), most)


class Means:
    """Averages of training residuals over stretches of time, weighted by sample count; for length 0 the residuals.

    Means do not depend on the phase of oscillations, which is far from linear where parameters are far off.

    Args:
        rows: of the residuals.
        length: of a stretch (s), 0 for none.
    """

    def __init__(self, rows: Rows, length: float) -> None:
        self._training = ~rows.held
        self._groups: NDArray[np.intp] | None = None
        if length > 0.0:
            columns = (rows.log, rows.sensor, (rows.time // length).astype(np.int64))
            names = np.column_stack([column[self._training] for column in columns])
            self._groups = np.unique(names, axis=0, return_inverse=True)[1].ravel()
            self._roots = np.sqrt(np.bincount(self._groups))

    def of(self, values: FloatArray) -> FloatArray:
        """Averages of residuals (rows,) over each of n stretches of time: (n,); of an array (rows, m): (n, m)."""
        chosen: FloatArray = values[self._training]
        if self._groups is None:
            return chosen
        if chosen.ndim == 1:
            return np.asarray(np.bincount(self._groups, weights=chosen) / self._roots, dtype=np.float64)
        return np.column_stack([np.bincount(self._groups, weights=column) / self._roots for column in chosen.T])


def _search(
    predictor: Predictor,
    told: Sequence[int],
    at: Evaluation,
    means: Means,
    most: int = MOST_EVALUATIONS,
    *,
    roughly: bool = False,
) -> tuple[Evaluation, bool]:
    """Minimise the cost of a calibration from an evaluation on; returns the best evaluation and whether converged."""
    low, high = (side[told] for side in predictor.bounds)
    point, damping, first, failed, taken = at.point.copy(), 0.0, len(predictor.evaluations), 0, 0
    while taken < MOST_ROUGH if roughly else len(predictor.evaluations) < first + most:
        step, size = _step(at, means, told, damping, (low - point[told], high - point[told]))
        if size < (NEAR if roughly else NO_STEP):
            return at, True
        beside = point.copy()
        beside[told] = np.clip(point[told] + step, low, high)
        try:
            tried = predictor.evaluate(beside, at if size < NEAR else None)
        except (EquilibriumError, CalibrationError):  # too far: no rest there, or the twin failed
            failed += 1
            if failed > MOST_FAILED:
                raise
            damping = max(10.0 * damping, LEAST_AFTER_FAILURE)
            continue
        taken += 1
        gained = cost(at, means) - cost(tried, means)
        if gained >= 0.0:
            damping = 0.0 if damping <= LEAST_DAMPING else damping / 10.0
            point, at = beside, tried
            if gained < NO_GAIN:
                return at, True
        elif size < NO_LONGER_SMOOTH:
            return at, True
        elif not at.fresh:
            at, taken = predictor.evaluate(point), taken + 1
        else:
            damping = max(10.0 * damping, LEAST_DAMPING)
    return at, False


def cost(evaluation: Evaluation, means: Means) -> float:
    """Cost of a calibration: half of the sum of squares of training residuals and deviations from the priors."""
    return 0.5 * float(np.sum(means.of(evaluation.residuals) ** 2) + np.sum(evaluation.point**2))


def _step(
    at: Evaluation,
    means: Means,
    told: Sequence[int],
    damping: float,
    bounds: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, float]:
    """Levenberg-Marquardt step within bounds, and its size in standard deviations of the estimates."""
    jacobian, residuals = means.of(at.jacobian)[:, told], means.of(at.residuals)
    normal = jacobian.T @ jacobian + np.eye(len(told))
    slope = jacobian.T @ residuals + at.point[told]
    root = np.linalg.cholesky(normal + damping * np.diag(np.diag(normal)))
    wanted = np.linalg.solve(root, -slope)  # of the triangle root.T @ step
    inside = np.minimum(bounds[0], -1e-12), np.maximum(bounds[1], 1e-12)
    found: FloatArray = lsq_linear(root.T, wanted, inside, method="bvls").x
    return found, float(np.sqrt(found @ normal @ found))


def _solution(
    predictor: Predictor, told: Sequence[int], prior: Evaluation, last: Evaluation, *, converged: bool, starts: int
) -> Solution:
    rows, parameters = predictor.rows, predictor.parameters
    covariance, inflated = intervals(last, rows, told)
    deviations = np.ones(len(parameters))
    deviations[told] = np.sqrt(np.diag(covariance))
    correlation = np.eye(len(parameters))
    if told:
        correlation[np.ix_(told, told)] = covariance / np.outer(deviations[told], deviations[told])
    low, high = predictor.bounds
    values, estimates = predictor.values(last.point), []
    for number, one in enumerate(parameters):
        at_bound = (
            number in told and min(last.point[number] - low[number], high[number] - last.point[number]) < AT_BOUND
        )
        factor = float(inflated[told.index(number)]) if number in told else 1.0
        deviation = float(deviations[number] * one.deviation)
        estimates.append(Estimate(one, float(values[number]), deviation, number in told, at_bound, factor))
    fits, count = _fits(rows, prior, last), len(predictor.evaluations)
    return Solution(tuple(estimates), correlation, fits, prior, last, converged, count, starts)


def _fits(rows: Rows, prior: Evaluation, last: Evaluation) -> tuple[Fit, ...]:
    """Fits of all sensors at an evaluation, beside those at the means of the priors."""
    fits = []
    for number, name in enumerate(rows.sensors):
        of_sensor = rows.sensor == number
        own, held = of_sensor & ~rows.held, of_sensor & rows.held
        if own.any() or held.any():
            before, after = (_rms(one.residuals[own]) for one in (prior, last))
            fits.append(Fit(name, before, after, _rms(last.residuals[held]), int(own.sum())))
    return tuple(fits)


def intervals(last: Evaluation, rows: Rows, told: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Covariance (n, n) of n identified parameters, scaled by prior deviations, and factors (n,) for model errors.

    The covariance is due to noise, priors and parameters that keep their priors (considered ones, Schmidt 1966).
    Errors of the model make residuals of neighbouring samples alike: sums of whole stretches of time then vary by
    more than noise does, from which the factor follows (Liang and Zeger 1986), or from the mean square of residuals.
    """
    training = ~rows.held
    jacobian, residuals = last.jacobian[training], last.residuals[training]
    own = jacobian[:, told]
    covariance = covariance_of(own)
    rest = [number for number in range(jacobian.shape[1]) if number not in told]
    noise = np.sqrt(np.diag(covariance))
    stretch = (rows.log[training] * 10**6 + rows.time[training] // STRETCH).astype(int)
    _, cluster = np.unique(stretch, return_inverse=True)
    count = int(cluster.max(initial=-1)) + 1
    factor = np.full(len(told), max(1.0, _rms(residuals)))
    if count >= FEWEST_CLUSTERS and told:
        sums = np.zeros((count, len(told)))
        np.add.at(sums, cluster, own * residuals[:, None])
        spread = covariance @ (sums.T @ sums) @ covariance * count / max(count - len(told), 1)
        factor = np.maximum(factor, np.sqrt(np.diag(spread)) / noise)
    covariance = covariance * np.outer(factor, factor)
    if rest:
        gain = -covariance_of(own) @ own.T @ jacobian[:, rest]
        covariance = covariance + gain @ gain.T
    return covariance, factor


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
