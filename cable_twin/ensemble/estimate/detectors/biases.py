"""Hypotheses beside a Kalman filter: none of its sensors is wrong by a constant, or one more of them is.

None of them needs a filter of its own. A constant error of one sensor changes all later estimates in proportion; these
sensitivities are carried along beside the filter (Friedland 1969). The innovations, less what such an error makes of
them, tell its size, and how likely it is (generalised likelihood ratio, Willsky and Jones 1976, with a prior).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np
import scipy  # loads `special` where it is used
from numpy.typing import NDArray

from cable_twin.basics.units import with_unit
from cable_twin.ensemble.estimate.detectors.alarm import Alarm
from cable_twin.ensemble.estimate.detectors.departures import CERTAIN
from cable_twin.ensemble.estimate.detectors.sensor_faults import Doubts
from cable_twin.ensemble.estimate.kalman import Belief
from cable_twin.mechanics.parameters import FloatArray

WRONG = 0.05  # of the load of a support at rest, by which its load cell may be wrong, a standard deviation
RARER = 4.0  # logarithm of how much rarer a wrong sensor is than none
DOUBT = 2e-9  # probability of all else, below which a sensor counts as wrong; so small as waves last for some updates
RIVALS = 1e-3  # the same of errors of all others alone, of a sensor that is kept with its error, or only suspected
REFUTED = -2.0  # logarithm of how likely, below which a sensor was right so far, and may become wrong from now on
HALVINGS = 30  # of the range in which a quantile of a mixture is
RECENT, RENEWED = 2, 5  # hypotheses of each sensor that may be recent, and updates after which one of them begins anew


class Biases:
    """Hypotheses of a constant error in one of several sensors of a Kalman filter, and what each makes of its belief.

    An error may be there from the beginning, or set in later: of each sensor there are several hypotheses, m in all.

    Args:
        deviations: standard deviation (N) of such an error of each load cell, by name.
        size: number n of quantities of the filter.
        recent: hypotheses of each sensor that it is wrong since lately; 0 for errors from the beginning alone.
        kept: sensors that are kept where they are wrong, as their error is known then.
    """

    def __init__(
        self, deviations: Mapping[str, float], size: int, recent: int = RECENT, kept: Collection[str] = ()
    ) -> None:
        self._recent, self._kept = recent, frozenset(kept)
        self._sensors = np.array(list(deviations) * (1 + recent))  # (m,) the first of each sensor, then the others
        self._least = np.array([deviations[name] ** -2 for name in self._sensors])  # inverse variances, at first
        self._usual = np.zeros(self._sensors.size)  # variances of errors that are none
        self._effects = np.zeros((size, self._sensors.size))  # of an error of 1 on the true mean, less the filter's
        self._evidence, self._known = np.zeros(self._sensors.size), np.diag(self._least)  # and inverse covariance, now
        self._updates = 0
        self._undone: set[str] = set()  # sensors left out, of which nothing is in the belief

    @property
    def _sizes(self) -> FloatArray:
        """Errors (m,), each if there is one."""
        sizes: FloatArray = self._evidence / np.diag(self._known)
        return sizes

    @property
    def _likelier(self) -> FloatArray:
        """Logarithms (m,) of how much likelier the innovations are with an error of each than with a usual one."""
        told = np.diag(self._known) - self._least

        def likely(variance: FloatArray) -> FloatArray:
            more: FloatArray = 1.0 + told * variance
            return 0.5 * (variance / more * self._evidence**2 - np.log(more))

        return likely(1.0 / self._least) - likely(self._usual)

    def expect(self, errors: Mapping[str, float]) -> None:
        """Take constant errors of the model in sensors, standard deviations (N) by name, for no faults of these."""
        self._usual = np.array([errors[name] ** 2 for name in self._sensors])

    def forget(self, rows: Sequence[int]) -> None:
        """Forget what errors would make of some quantities (by row), as these are reset."""
        self._effects[rows] = 0.0

    def keep_within(self, least: FloatArray, most: FloatArray, mean: FloatArray) -> None:
        """Account for estimates that are brought within bounds; each hypothesis is brought there by itself.

        Args:
            least: (k,) lower bounds of the first k quantities.
            most: (k,) upper bounds of the same.
            mean: (n,) estimates before that.
        """
        mean, sizes = mean[: least.size], self._sizes
        within = np.clip(mean, least, most)
        for row in np.flatnonzero(within != mean):
            moved = np.clip(mean[row] + self._effects[row] * sizes, least[row], most[row]) - within[row]
            self._effects[row] = np.divide(moved, sizes, out=np.zeros_like(sizes), where=sizes != 0.0)

    def carry(self, transition: FloatArray) -> None:
        """Account for a Kalman prediction with a transition matrix (n, n) of the quantities."""
        self._effects = transition @ self._effects

    def note(
        self,
        sensors: Sequence[str],
        innovation: FloatArray,
        jacobian: FloatArray,
        variance: FloatArray,
        prior: Belief,
        told: bool = True,
        elsewhere: Mapping[str, FloatArray] = MappingProxyType({}),
    ) -> None:
        """Account for a Kalman update by measurements of k sensors; arguments as of `kalman.update`.

        Args:
            sensors: (k,) names.
            innovation: (k,) measured less predicted values.
            jacobian: (k, n) derivatives of the predicted values.
            variance: (k,) of the noise.
            prior: belief before the update.
            told: False for an update that moves the means, but will be repeated: it tells nothing.
            elsewhere: (k,) what an error of 1 of a sensor, by name, adds to all measurements beside its own.
        """
        own: FloatArray = (np.array(sensors)[:, None] == self._sensors).astype(np.float64)
        for name, more in elsewhere.items():
            own[:, self._sensors == name] += more[:, None]
        of_errors = jacobian @ self._effects + own
        covariance = jacobian @ prior.covariance
        weighted = np.linalg.solve(covariance @ jacobian.T + np.diag(variance), of_errors)
        self._effects -= covariance.T @ weighted
        if not told:
            return
        self._evidence += weighted.T @ innovation
        self._known += of_errors.T @ weighted
        self._updates += 1
        if self._recent:
            self._renew()

    def follow(self, sensors: Sequence[str], jacobian: FloatArray, gain: FloatArray) -> None:
        """Account for an update of some quantities alone, which tells nothing of errors.

        Args:
            sensors: (k,) names.
            jacobian: (k, n) derivatives of the predicted values.
            gain: (n, k) of the update.
        """
        self._effects -= gain @ (jacobian @ self._effects + (np.array(sensors)[:, None] == self._sensors))

    def _renew(self) -> None:
        """Begin anew with hypotheses that are refuted, and from time to time with the least likely recent ones."""
        self._restart(self._likelier < REFUTED)
        if self._updates % RENEWED == 0:
            later = self._likelier.reshape(1 + self._recent, -1)[1:]
            self._restart((np.arange(1 + self._recent)[:, None] == 1 + later.argmin(axis=0)).ravel())

    def surely(self, rivals: float = DOUBT) -> tuple[str, float]:
        """Sensor that is wrong for sure and its error; an empty name where there is none.

        Args:
            rivals: probability of errors of all others, below which it is this one of a sensor that is not kept.
        """
        weights = self._weights(self._sensors)
        shares = {str(name): float(weights[self._sensors == name].sum()) for name in self._sensors}
        worst = max(shares, key=lambda name: shares[name])
        beside = sum(shares.values()) - shares[worst]
        if max(1.0 - sum(shares.values()), 0.0) > DOUBT or beside > (RIVALS if worst in self._kept else rivals):
            return "", 0.0
        return worst, float(self._sizes @ np.where(self._sensors == worst, weights, 0.0))

    def deviation_of(self, sensor: str) -> float:
        """Standard deviation of the error of a sensor, if there is one from the beginning on."""
        row = int(np.argmax(self._sensors == sensor))
        return float(self._known[row, row] ** -0.5)

    def judge(self, time: float, belief: Belief, doubts: Doubts, may_name: bool = True) -> tuple[Belief, list[Alarm]]:
        """Leave out a sensor that is wrong for sure; returns the belief without those left out by now, and alarms.

        One that seems to be wrong, unless another one is, is told before, and counts as far as it may be right.

        Args:
            time: s.
            belief: of the filter.
            doubts: about its sensors.
            may_name: False where a fault of the plant may explain as much as a wrong sensor, so that none is left out.
        """
        alarms = [*self._suspect(time, doubts)] if may_name and not self._recent else []
        wrong, error = self.surely() if may_name else ("", 0.0)
        if wrong and wrong not in (*self._kept, *doubts.left_out):
            text = f"sensor {wrong} contradicts all others by {with_unit(error, 'N', 2)} and is left out"
            alarms.append(doubts.leave_out(wrong, time, text))
        for name in [name for name in doubts.left_out if name not in self._undone]:
            belief = self.without(belief, name)
        self._undone = {*doubts.left_out}
        return belief, alarms

    def _suspect(self, time: float, doubts: Doubts) -> Iterator[Alarm]:
        """Alarm about a sensor that seems to be wrong, but not for sure, once."""
        wrong, error = self.surely(RIVALS)
        if wrong not in ("", *self._kept, *doubts.mistrusted, *doubts.left_out) and not self.surely()[0]:
            doubts.mistrusted.add(wrong)
            unless = f"that another load cell is instead has a probability below {100.0 * RIVALS:g} %"
            yield Alarm(time, f"sensor {wrong} seems to be wrong by {with_unit(error, 'N', 2)}: {unless}")

    def believed(self, belief: Belief) -> Belief:
        """Belief over all hypotheses, each as likely as it is: mean and covariance of their mixture."""
        return self._mixed(belief, self._weights(self._sensors))

    def agreed(self, belief: Belief) -> Belief:
        """Belief of which `CERTAIN` deviations cover all that is as probable over all hypotheses as that many of one.

        Beyond them is only what hypotheses agree on, but those which are less probable than that by themselves.
        """
        weights = self._weights(self._sensors)
        shares = np.append(weights, 1.0 - weights.sum())
        effects = np.column_stack([self._effects, np.zeros(belief.mean.size)])
        means = belief.mean[:, None] + effects * np.append(self._sizes, 0.0)
        variances = np.diag(belief.covariance)[:, None] + effects**2 / np.append(np.diag(self._known), 1.0)
        least, most = (side * _quantiles(side * means, np.sqrt(variances), shares) for side in (-1.0, 1.0))
        return Belief(0.5 * (least + most), np.diag(((most - least) / (2.0 * CERTAIN)) ** 2))

    def without(self, belief: Belief, sensor: str) -> Belief:
        """Belief without what a sensor that is left out has told wrongly; others may be wrong beside it."""
        if sensor not in self._sensors:
            return belief
        weights = self._weights([sensor])
        found, row = self._mixed(belief, weights), int(np.argmax(weights))
        if weights.sum() > 0.5:
            shares = self._known[row] / self._known[row, row]
            self._effects = self._effects - np.outer(self._effects[:, row], shares)
            self._evidence = self._evidence - self._evidence[row] * shares
            self._known = self._known - np.outer(self._known[row], shares)
        self._restart(self._sensors == sensor)
        return found

    def _weights(self, sensors: Sequence[str] | NDArray[np.str_]) -> FloatArray:
        """Probabilities (m,) of an error, where only some sensors, by name, may be wrong."""
        likelier = np.where(np.isin(self._sensors, sensors), self._likelier - RARER, -np.inf)
        weights: FloatArray = np.exp(likelier - np.logaddexp.reduce(np.append(likelier, 0.0)))
        return weights

    def _mixed(self, belief: Belief, weights: FloatArray) -> Belief:
        """Mixture of the beliefs with an error, by their probabilities (m,), and of that without any."""
        moved = self._effects @ (weights * self._sizes)
        more = (self._effects * weights * (1.0 / np.diag(self._known) + self._sizes**2)) @ self._effects.T
        return Belief(belief.mean + moved, belief.covariance + more - np.outer(moved, moved))

    def _restart(self, which: NDArray[np.bool_]) -> None:
        self._effects[:, which], self._evidence[which] = 0.0, 0.0
        self._known[which], self._known[:, which] = 0.0, 0.0
        self._known[which, which] = self._least[which]


def _quantiles(means: FloatArray, deviations: FloatArray, shares: FloatArray) -> FloatArray:
    """Values (n,) that n mixtures of normal distributions exceed as rarely as one exceeds `CERTAIN` deviations.

    Args:
        means: (n, m) of the m parts of each.
        deviations: (n, m) likewise.
        shares: (m,) of the parts, 1 in all.
    """
    rare = float(scipy.special.ndtr(-CERTAIN))
    low, high = (side(means + CERTAIN * deviations, axis=1) for side in (np.min, np.max))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        beyond = scipy.special.ndtr((means - middle[:, None]) / deviations) @ shares > rare
        low, high = np.where(beyond, middle, low), np.where(beyond, high, middle)
    found: FloatArray = 0.5 * (low + high)
    return found
