"""Doubt about forces whose waves have other phases in the twin than in the plant, as after a stop or in a silence."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.quantities import Estimate

CALMED, MEAN = 40.0, 10.0  # s, in which the waves calm down, and over which their size is taken
SWINGING = 5.0  # s of silence, after which a carriage may swing as one whose drive has stopped


class LineWaves:
    """Variances of forces by waves that were stirred: twice what these have in the twin.

    That is the variance of the difference of two waves of this size whose phases have nothing in common.
    """

    def __init__(self) -> None:
        self._stirred = -np.inf  # s
        self._moments: dict[str, tuple[float, float, float]] = {}  # time (s), mean (N) and mean square (N^2)

    def stir(self, time: float) -> None:
        """Begin to doubt forces at a time (s)."""
        self._stirred = time

    def variance(self, time: float, name: str, force: float) -> float:
        """Variance (N^2) of a force (N) by name at a time (s), which is asked for window by window."""
        before, mean, square = self._moments.get(name, (time, force, force**2))
        new = 1.0 - float(np.exp(min(before - time, 0.0) / MEAN))
        mean, square = mean + new * (force - mean), square + new * (force**2 - square)
        self._moments[name] = time, mean, square
        share = float(np.exp(min(self._stirred - time, 0.0) / CALMED))
        return 2.0 * share * (max(square - mean**2, 0.0) + (force - mean) ** 2)


class Unheard:
    """Estimates of a twin that goes on alone, with the doubt what its plant does meanwhile.

    A force may still be what it was when the plant fell silent, and has waves of other phases than in the twin. A body
    may swing by the angle of a pendulum whose pivot slows down.

    Args:
        stopping: deceleration of a stop over gravity.
    """

    def __init__(self, stopping: float) -> None:
        self._stopping, self._waves = stopping, LineWaves()
        self._last: Mapping[str, Estimate] = {}  # of what is hidden, as it was told last while the plant was heard

    def forget(self) -> None:
        """Forget what was told, as the twin begins anew."""
        self._last = {}

    def followed(self, correction: Correction) -> None:
        """Take what the twin says while it hears its plant."""
        self._last = correction.hidden
        self._variances(correction)

    def widened(self, alone: Correction, silent: float) -> Correction:
        """Estimates with more doubt, of a twin that has gone on alone for some seconds."""
        self._waves.stir(alone.time)
        waves, swing = self._variances(alone), min(silent / SWINGING, 1.0) * self._stopping

        def more_doubted(name: str, one: Estimate) -> Estimate:
            moved = one.value - self._last.get(name, one).value
            more = swing**2 if one.unit == "rad" else moved**2 + waves.get(name, 0.0)
            return one._replace(deviation=(one.deviation**2 + more) ** 0.5)

        return alone._replace(hidden={name: more_doubted(name, one) for name, one in alone.hidden.items()})

    def _variances(self, correction: Correction) -> dict[str, float]:
        """Variances (N^2) of hidden forces by waves."""
        forces = {name: one.value for name, one in correction.hidden.items() if one.unit == "N"}
        return {name: self._waves.variance(correction.time, name, force) for name, force in forces.items()}
