"""Scatter of a plant's measurements about the model: waves that no mesh of the twin resolves.

Waves are told from noise by successive samples, which they move alike: the covariance of a sample with the next one is
about the variance of the waves, and that of noise is zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cable_twin.mechanics.parameters import FloatArray

MEMORY = 20.0  # s, in which waves are forgotten
WAVING = 60.0  # s, in which waves that are expected calm down
SURE_SHARE = 0.3  # of the assumed variance, from which on the average over windows is not by chance
SURE_IN_WINDOW = 1.0  # the same of a window by itself
FEWEST = 5  # samples of a window that tell of waves
SLOWER = 5.0  # times: waves as long as a window are that much larger if its samples are taken as independent
OF_THESE = 1.0  # windows, as which that counts beside what the means of windows show of the waves that there are


def waves_in(values: FloatArray) -> float:
    """Variance of waves in samples (n,), as the covariance of successive ones; NaN for fewer than `FEWEST`."""
    if values.size < FEWEST:
        return float("nan")
    about = values - values.mean()
    return float(about[1:] @ about[:-1]) / (values.size - 1)


def excuse(differences: FloatArray, variance: FloatArray) -> float:
    """Extra variance of a sensor's samples due to waves within one window, which are no fault of the sensor.

    A steady change is none, as of a force that grows while a counterweight is stuck, and neither is a jump: waves are
    in both halves of a window.

    Args:
        differences: (n,) samples less what the model says.
        variance: (n,) of each sample.
    """
    number = np.arange(differences.size) - 0.5 * (differences.size - 1)
    steady = (number @ differences) / max(float(number @ number), 1.0) * number
    waves = min(map(waves_in, np.array_split(differences - steady, 2)))
    return SLOWER**2 * waves if waves > SURE_IN_WINDOW * variance[0] else 0.0


class Scatter:
    """Variance of waves in what each sensor measures, as an average over windows.

    A sensor that is biased, stuck, noisy, or swapped shows no waves but in the window in which it becomes so. So the
    median of three windows stands for each, and this hides no fault.

    Args:
        sensors: their names.
    """

    def __init__(self, sensors: Sequence[str]) -> None:
        self._found = dict.fromkeys(sensors, (0.0, 0.0, 0.0))  # weighted sums: of waves, assumed variances, windows
        self._last = dict.fromkeys(sensors, (0.0, 0.0))  # waves in the last two windows
        self._means = dict.fromkeys(sensors, (0.0, 0.0))  # weighted sums while it waves: of what means show, of windows
        self._assumed = dict.fromkeys(sensors, 0.0)  # variance of a sample in the last window
        self._expected = 0.0  # remaining share of waves that have been excited

    def expect(self) -> None:
        """Take all that scatters for waves at first, as who boards has excited waves."""
        self._expected = 1.0

    def stir(self, deviations: Mapping[str, float]) -> None:
        """Expect waves with standard deviations in some sensors, by name, as if the last windows had shown them."""
        for sensor, one in deviations.items():
            self._found[sensor], self._last[sensor] = (one**2, 0.0, 1.0), (one**2, one**2)
            self._means[sensor] = 0.0, 0.0

    def lasting(self, sensor: str) -> float:
        """Variance of waves in a sensor's samples, taken as independent although waves last for seconds.

        How much waves are left in the mean of a window depends on how long they are: all of those that are longer than
        it, and little of short ones. That is found by the means of the windows since the sensor waves.
        """
        waves, assumed, (shown, windows) = self.unexplained(sensor), self._assumed[sensor], self._means[sensor]
        found = (OF_THESE * (SLOWER**2 * waves + assumed) + shown) / (OF_THESE + windows)
        return float(np.clip(found - assumed, waves, SLOWER**2 * waves))

    def note(
        self,
        lasted: float,
        sensors: Sequence[str],
        differences: FloatArray,
        assumed: FloatArray,
        before: FloatArray,
    ) -> None:
        """Update the average variances of waves by the samples of one window.

        Args:
            lasted: length of the window, s.
            sensors: (n,) sensor of each sample, in the order of time.
            differences: (n,) samples less what the model says.
            assumed: (n,) variance of each sample by noise and usual errors of the model.
            before: (n,) samples less what the model said before it was corrected by them. The product of both is on
                average the variance of the error of a measurement (Desroziers et al. 2005).
        """
        self._expected *= float(np.exp(-lasted / WAVING))
        kept, names = float(np.exp(-lasted / MEMORY)), np.array(sensors)
        for name in dict.fromkeys(sensors):
            own = names == name
            waves, known, windows = (kept * one for one in self._found[name])
            now, last = waves_in(differences[own]), self._last[name]
            if np.isfinite(now):
                waves += float(np.median([now, *last]))
                known += float(assumed[own].mean())
                windows += 1.0
                self._last[name] = now, last[0]
            self._found[name] = waves, known, windows
            shown, counted = (kept * one for one in self._means[name])
            shown += own.sum() * float(differences[own].mean() * before[own].mean())
            self._means[name] = (shown, counted + 1.0) if self.unexplained(name) else (0.0, 0.0)
            self._assumed[name] = float(assumed[own].mean())

    def unexplained(self, sensor: str) -> float:
        """Variance of waves in a sensor's values, which usual errors do not explain; 0 where it is not significant."""
        waves, known, windows = self._found[sensor]
        sure = waves > SURE_SHARE * (1.0 - self._expected) * known
        return waves / windows if windows > 0.0 and sure else 0.0
