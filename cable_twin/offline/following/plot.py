"""Plot of the estimates of a followed plant over time with 95 % bands, beside true values where known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # no screen needed

import matplotlib.pyplot as plt
import numpy as np

from cable_twin.ensemble.estimate.follower import Correction
from cable_twin.frame.records import FloatArray
from cable_twin.offline.plots import COLORS, INK, STYLE

BAND = 1.959964  # standard deviations of a band of 95 %
HEIGHT, WIDTH = 1.9, 11.0  # inches, of a row and of the picture
SHOWN = {"N": ("kN", 1e-3), "rad": ("deg", 180.0 / np.pi), "kg": ("kg", 1.0)}
Truth = Mapping[str, tuple[FloatArray, FloatArray]]  # times (s) and values by name


def write_estimates(title: str, corrections: Sequence[Correction], truth: Truth, path: Path) -> None:
    """Draw all estimates of a followed plant over time with 95 % bands into a file.

    Args:
        title: of the picture.
        corrections: in the order of time, at least one.
        truth: times (s) and true values of the plant, by the name of the estimate.
        path: file of the picture.

    Raises:
        OSError: the file cannot be written.
    """
    times = np.array([one.time for one in corrections])
    names = [*corrections[-1].slow, *corrections[-1].hidden]
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]  # matplotlib lists every key
        rows = (len(names) + 1) // 2
        figure, panels = plt.subplots(rows, 2, figsize=(WIDTH, HEIGHT * rows + 0.8), sharex=True, squeeze=False)
        for panel, name in zip(panels.flat, names, strict=False):
            found = [(one.slow | one.hidden)[name] for one in corrections]
            unit, scale = SHOWN.get(found[0].unit, (found[0].unit, 1.0))
            values, deviations = scale * np.array([[one.value, one.deviation] for one in found]).T
            if name in truth:
                panel.plot(truth[name][0], scale * truth[name][1], color=INK, linewidth=0.8, label="plant")
            low, high = values - BAND * deviations, values + BAND * deviations
            panel.fill_between(times, low, high, color=COLORS[0], alpha=0.3, linewidth=0.0, label="95 %")
            panel.plot(times, values, color=COLORS[0], linewidth=1.2, label="estimate")
            later = times > 0.15 * times[-1]  # the prior is wider than all that follows
            shown = [*low[later], *high[later]]
            if name in corrections[-1].slow:
                shown += [*(scale * truth[name][1])] if name in truth else []
                margin = 0.1 * (max(shown) - min(shown)) + 1e-12
                panel.set_ylim(min(shown) - margin, max(shown) + margin)
            panel.set_title(f"{name}, {unit}", loc="left", fontsize=9)
        for panel in panels.flat[len(names) :]:
            panel.set_visible(False)
        panels.flat[0].legend(fontsize=8, loc="best")
        for panel in panels[-1]:
            panel.set_xlabel("s")
        figure.suptitle(title, x=0.012, ha="left", fontweight="bold", fontsize=13.0)
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.99))
        figure.savefig(path)
        plt.close(figure)
