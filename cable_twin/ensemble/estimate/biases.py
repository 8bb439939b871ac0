"""Hypotheses beside a Kalman filter: none of its sensors is wrong by a constant, or one more of them is.

None of them needs a filter of its own. A constant error of one sensor changes all later estimates in proportion; these
sensitivities are carried along beside the filter (Friedland 1969). The innovations, less what such an error makes of
them, tell its size, and how likely it is (generalised likelihood ratio, Willsky and Jones 1976, with a prior).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cable_twin.ensemble.estimate.alarms import CERTAIN
from cable_twin.ensemble.estimate.kalman import Belief
from cable_twin.mechanics.parameters import FloatArray

RARER = 4.0  # logarithm of how much rarer a wrong sensor is than none
DOUBT = 2e-9  # probability of all else, below which a sensor counts as wrong; so small as waves last for some updates
REFUTED = -2.0  # logarithm of how likely, below which a sensor was right so far, and may become wrong from now on
RECENT, RENEWED = 2, 5  # hypotheses of each sensor that may be recent, and updates after which one of them begins anew


class Biases:
    """Hypotheses of a constant error in one of several sensors of a Kalman filter, and what each makes of its belief.

    An error may be there from the beginning, or set in later: of each sensor there are several hypotheses, m in all.

    Args:
        deviations: standard deviation of such an error of each sensor, in its unit, by name.
        size: number n of quantities of the filter.
    """

    def __init__(self, deviations: Mapping[str, float], size: int) -> None:
        self._sensors = np.array(list(deviations) * (1 + RECENT))  # (m,) the first of each sensor, then the others
        self._least = np.array([deviations[name] ** -2 for name in self._sensors])  # inverse variances, at first
        self._effects = np.zeros((size, self._sensors.size))  # of an error of 1 on the true mean, less the filter's
        self._evidence, self._known = np.zeros(self._sensors.size), np.diag(self._least)  # and inverse covariance, now
        self._updates = 0

    @property
    def _sizes(self) -> FloatArray:
        """Errors (m,), each if there is one."""
        sizes: FloatArray = self._evidence / np.diag(self._known)
        return sizes

    @property
    def _likelier(self) -> FloatArray:
        """Logarithms (m,) of how much likelier the innovations are with an error of each than without any."""
        likelier: FloatArray = 0.5 * (self._sizes * self._evidence - np.log(np.diag(self._known) / self._least))
        return likelier

    def forget(self, rows: Sequence[int]) -> None:
        """Forget what errors would make of some quantities (by row), as these are reset."""
        self._effects[rows] = 0.0

    def decay(self, factors: FloatArray) -> None:
        """Account for a Kalman prediction in which the quantities decay by factors (n,)."""
        self._effects *= factors[:, None]

    def note(
        self, sensors: Sequence[str], innovation: FloatArray, jacobian: FloatArray, variance: FloatArray, prior: Belief
    ) -> None:
        """Account for a Kalman update by measurements of k sensors; arguments as of `kalman.update`.

        Args:
            sensors: (k,) names.
            innovation: (k,) measured less predicted values.
            jacobian: (k, n) derivatives of the predicted values.
            variance: (k,) of the noise.
            prior: belief before the update.
        """
        of_errors = jacobian @ self._effects + (np.array(sensors)[:, None] == self._sensors)
        covariance = jacobian @ prior.covariance
        weighted = np.linalg.solve(covariance @ jacobian.T + np.diag(variance), of_errors)
        self._evidence += weighted.T @ innovation
        self._known += of_errors.T @ weighted
        self._effects -= covariance.T @ weighted
        self._restart(self._likelier < REFUTED)
        self._updates += 1
        if self._updates % RENEWED == 0:
            later = self._likelier.reshape(1 + RECENT, -1)[1:]
            self._restart((np.arange(1 + RECENT)[:, None] == 1 + later.argmin(axis=0)).ravel())

    def surely(self) -> tuple[str, float]:
        """Sensor that is wrong for sure and its error; an empty name where there is none."""
        weights = self._weights(self._sensors)
        shares = {str(name): float(weights[self._sensors == name].sum()) for name in self._sensors}
        worst = max(shares, key=lambda name: shares[name])
        if 1.0 - shares[worst] > DOUBT:
            return "", 0.0
        return worst, float(self._sizes @ np.where(self._sensors == worst, weights, 0.0))

    def believed(self, belief: Belief) -> Belief:
        """Belief over all hypotheses, each as likely as it is: mean and covariance of their mixture."""
        return self._mixed(belief, self._weights(self._sensors))

    def agreed(self, belief: Belief) -> Belief:
        """Belief in which all hypotheses agree, however unlikely: `CERTAIN` deviations cover those of each of them."""
        effects = np.column_stack([self._effects, np.zeros(belief.mean.size)])
        means = belief.mean[:, None] + effects * np.append(self._sizes, 0.0)
        variances = np.diag(belief.covariance)[:, None] + effects**2 / np.append(np.diag(self._known), 1.0)
        margins = CERTAIN * np.sqrt(variances)
        least, most = (means - margins).min(axis=1), (means + margins).max(axis=1)
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
