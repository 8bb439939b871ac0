"""Payloads that change while their carriages stand in stations: when that begins and ends, and what they are then."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from copy import deepcopy

import numpy as np

from cable_twin.ensemble.estimate.detectors.biases import Biases
from cable_twin.ensemble.estimate.kalman import Belief, Terms, corrected, gain_of, reset
from cable_twin.ensemble.estimate.quantities import SLOW
from cable_twin.ensemble.estimate.swings import ANY_SWING
from cable_twin.mechanics.parameters import FloatArray

WINDOWS = 4  # one after the other, in which a payload that does not change has to be the same
SURELY = 4.0  # standard deviations of their noise, by which it is not
SWINGING = 0.5  # m/s, up to which a carriage stands whose payload changes


class Boarding:
    """Detector of payloads that change, as people get on and off, and their estimates from each window by itself.

    Each window gives the payloads as if nothing was known of them; where these differ, people board. All else,
    friction, wind, ice and counterweights, is kept as it was known before, so that no payload is put down to it.

    Attributes:
        changing: whether payloads change, so that no sensor can be judged by them.

    Args:
        deviations: (k,) standard deviations of the slow quantities, the first ones of a belief, at first.
        swings: number of the swings, the next ones, which boarding may excite.
        loads: place of each payload in the numbers of a frame, by row of the quantity.
    """

    def __init__(self, deviations: FloatArray, swings: int, loads: Mapping[int, int]) -> None:
        self._deviations, self._loads = deviations, loads
        self._swings = range(deviations.size, deviations.size + swings)
        self.changing, self._settled, self._agreed = False, False, False
        self._rows: list[int] = []
        self._carried = self._loaded = np.zeros(0)  # kg, by the members now, and since the last window
        self._before = np.zeros(0)  # kg, payloads before they changed
        self._seen: deque[tuple[FloatArray, Terms]] = deque(maxlen=WINDOWS)  # means and measurements of windows
        self._known: deque[tuple[Belief, Biases]] = deque(maxlen=WINDOWS)  # before these windows

    @property
    def rows(self) -> list[int]:
        """Rows of the payloads that change."""
        return self._rows if self.changing else []

    @property
    def slow(self) -> float:
        """Speed (m/s) below which a carriage stands in its station: it swings while people board."""
        return SWINGING if self.changing else SLOW

    @property
    def stirs(self) -> bool:
        """Whether payloads change or have changed in this stay, so that carriages move by some centimetres."""
        return self.changing or self._settled

    def stirred(self, values: FloatArray) -> float:
        """Waves that a change to payloads, the values (n,) of all quantities, has stirred, as a share of a tower's."""
        changes = np.abs(values[self._rows] - self._before) / self._deviations[self._rows]
        return min(float(changes.max(initial=0.0)), 1.0)

    def forget(self) -> None:
        """Forget the last windows, as no carriage stands in a station any more, or the twin begins anew."""
        self.changing, self._settled, self._agreed, self._rows = False, False, False, []
        self._seen.clear()
        self._known.clear()

    def note_loads(self, points: FloatArray, belief: Belief, numbers: FloatArray) -> None:
        """Take what members have been loaded with, by their frames (members, n), for the changing payloads.

        Args:
            points: (2 n + 1, n) of the members, which get them.
            belief: whose means get those of the middle one.
            numbers: (members, n) of their frames.
        """
        if rows := self.rows:
            points[:, rows] = numbers[: len(points), [self._loads[row] for row in rows]]
            belief.mean[rows] = points[0, rows]
            self._carried, self._loaded = belief.mean[rows], belief.mean[rows] - self._carried

    def doubted(self, rows: list[int], belief: Belief) -> Belief:
        """Belief in which nothing is known of some payloads (by row); their means stay."""
        doubted = reset(belief, rows, belief.mean[rows], self._deviations[rows])
        for row in self._swings:
            doubted.covariance[row, row] = max(doubted.covariance[row, row], ANY_SWING**2)
        return doubted

    def look(self, rows: list[int], terms: Terms, belief: Belief, biases: Biases, contradicted: bool) -> bool:
        """Look at a window in which carriages stand in stations; returns whether boarding has just begun.

        Args:
            rows: of the payloads that may change.
            terms: of the measurements of the window, as of `kalman.update`, about the belief.
            belief: before the window.
            biases: of its sensors.
            contradicted: whether a sensor contradicts the others; where none did in the window before, somebody may
                have boarded, but once in a stay.
        """
        if rows != self._rows:
            self.forget()
            self._rows = rows
        if contradicted and not (self.changing or self._agreed):
            self._seen.clear()  # a sensor is wrong, and with it the payloads
        self._seen.append((belief.mean.copy(), terms))
        if not self.changing:
            self._known.append((belief, deepcopy(biases)))
        *earlier, (values, variances) = self._payloads(belief)
        moved = any((np.abs(values - one) > SURELY * np.sqrt(variances + own)).any() for one, own in earlier)
        begins = not self.changing and (moved or (contradicted and self._agreed and not self._settled))
        self._agreed = not contradicted
        if begins:
            self.changing, self._carried, self._loaded = True, belief.mean[rows], np.zeros(len(rows))
            self._before = self._known[0][0].mean[rows]
        elif self.changing and not moved and len(self._seen) == WINDOWS:
            self.changing, self._settled = False, True
            self._known.clear()
        return begins

    def _payloads(self, belief: Belief) -> list[tuple[FloatArray, FloatArray]]:
        """Payloads (kg) by each of the last windows alone, with variances by noise, all else as it is believed now.

        What a window says of a payload depends on wind, ice and friction: of those that were believed then, as of a
        wind that was not known yet, two windows would differ although nobody has boarded.
        """
        found, doubted = list[tuple[FloatArray, FloatArray]](), self.doubted(self._rows, belief)
        for mean, (innovation, jacobian, variance) in self._seen:
            apart = belief.mean - mean
            apart[[*self._rows, *self._swings]] = 0.0  # each window has its own
            gain = gain_of(doubted, jacobian, variance)[self._rows]
            found.append((mean[self._rows] + gain @ (innovation - jacobian @ apart), (gain**2) @ variance))
        return found

    @property
    def before(self) -> tuple[Belief, Biases]:
        """Belief and hypotheses from before the windows in which payloads have begun to change."""
        return self._known[0]

    def take(self, terms: Terms, sensors: Sequence[str], belief: Belief, biases: Biases) -> Belief:
        """Correct the changing payloads and the swings alone by the measurements of a window.

        Args:
            terms: about the belief.
            sensors: of the measurements.
            belief: in which nothing is known of the payloads, see `doubted`.
            biases: of its sensors, which follow.
        """
        gain = gain_of(belief, *terms[1:])
        corrects = [*self._rows, *self._swings]
        gain[[row for row in range(belief.mean.size) if row not in corrects]] = 0.0
        biases.follow(sensors, terms[1], gain)
        found = corrected(belief, *terms, gain)
        rows = self._rows  # at the end of the window they are not what they were in the middle, in plant and twin
        moved = (found.mean[rows] - belief.mean[rows]) ** 2 + (0.5 * self._loaded) ** 2
        found.covariance[rows, rows] += moved
        return found

    def apart(
        self, points: FloatArray, wanted: FloatArray, low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Stencil points to which states are blended, and those that the members get.

        Members are loaded to payloads that change as the plant is, from the states as they are: towers hold by
        friction what a changed payload does to the rope, unlike in members that began at rest with other payloads.

        Args:
            points: (2 n + 1, n) of the members, see `stencil`.
            wanted: (2 n + 1, n) likewise, around the present belief.
            low: (n,) least values.
            high: (n,) largest values.
        """
        if not self.changing:
            return wanted, wanted
        blended, given, rows = wanted.copy(), wanted.copy(), self._rows
        blended[:, rows] = points[:, rows]
        least, most = low[rows] - points[:, rows].min(axis=0), high[rows] - points[:, rows].max(axis=0)
        given[:, rows] = points[:, rows] + np.clip(wanted[0, rows] - points[0, rows], least, most)
        return blended, given
