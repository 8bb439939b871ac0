"""Scatter of a plant's measurements about the model: fast error of the model that no mesh of the twin explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cable_twin.mechanics.parameters import FloatArray

MEMORY = 20.0  # s, in which a scatter is forgotten
BEYOND = 1.5  # times the variance that is assumed, from which on a scatter tells of another error
FEWEST = 5  # samples of a window that have a scatter
SLOWER = 3.0  # times: as such errors last longer than a sample, they are that much larger if taken as independent


class Scatter:
    """Variance of each sensor's samples about their mean difference from the model, as an average over windows.

    A sensor that is biased, stuck, or swapped scatters no more than before, so that this hides no fault.

    Args:
        sensors: their names.
    """

    def __init__(self, sensors: Sequence[str]) -> None:
        self._found = dict.fromkeys(sensors, (0.0, 0.0, 0.0))  # weighted sums: squares, assumed variances, degrees

    def note(self, lasted: float, differences: Mapping[str, FloatArray], assumed: Mapping[str, float]) -> None:
        """Add the samples of a window.

        Args:
            lasted: length of the window, s.
            differences: (n,) samples less what the model says, of each sensor.
            assumed: variance of a sample by noise and usual errors of the model, of each sensor.
        """
        kept = float(np.exp(-lasted / MEMORY))
        for name, values in differences.items():
            squares, known, degrees = (kept * one for one in self._found[name])
            if values.size >= FEWEST:
                more = values.size - 1
                squares += float(np.sum((values - values.mean()) ** 2))
                known += assumed[name] * more
                degrees += more
            self._found[name] = squares, known, degrees

    def unexplained(self, sensor: str) -> float:
        """Variance of a sample beyond noise and usual errors of the model, of a sensor; 0 where it may be by chance."""
        squares, known, degrees = self._found[sensor]
        return (squares - known) / degrees if degrees > 0.0 and squares > BEYOND * known else 0.0
