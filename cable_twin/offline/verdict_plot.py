"""Plot of the verdicts of rule profiles: utilisation of the limit of each check, profiles side by side."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # no screen needed

import matplotlib.pyplot as plt
from matplotlib.patches import Patch

from cable_twin.key_figures.rules import RuleVerdict
from cable_twin.key_figures.rules.comparison import topic_of
from cable_twin.key_figures.rules.verdicts import BROKEN, KEPT, OUTSIDE, limit_text, value_text
from cable_twin.offline.plots import COLORS, INK, QUIET, STYLE

MOST = 1.6  # share of a limit at which bars end
HEIGHT, WIDTH = 0.34, 11.0  # inches, of a bar and of the picture


def used_share(one: RuleVerdict) -> float:
    """Utilisation of the limit of a rule verdict by its figure, cut off at `MOST`; above 1 the limit is not kept."""
    assert one.value is not None
    low, high, value = one.limits[0], one.limits[-1], one.value
    above = abs(value / high) if high else float(value > 0.0)
    below = abs(low / value) if value else float(low > 0.0) * MOST
    shares = {"at most": above, "below": above, "at least": below, "above": below, "within": max(above, below)}
    return min(shares[one.comparison], MOST)


def write_verdict_plot(title: str, verdicts: Sequence[RuleVerdict], path: Path) -> bool:
    """Draw rule verdicts that have a figure and a limit as bars into a file; returns whether there are any.

    Args:
        title: of the picture.
        verdicts: of all profiles.
        path: file of the picture.

    Raises:
        OSError: the file cannot be written.
    """
    shown = [one for one in verdicts if one.limits and one.value is not None and one.state != OUTSIDE]
    if not shown:
        return False
    profiles = list(dict.fromkeys(one.profile for one in shown))
    topics = list(dict.fromkeys(topic_of(one.quantity) for one in shown))
    shown.sort(key=lambda one: (topics.index(topic_of(one.quantity)), profiles.index(one.profile)))
    with mpl.rc_context(STYLE):  # type: ignore[arg-type]  # matplotlib lists every key
        figure, axes = plt.subplots(figsize=(WIDTH, HEIGHT * len(shown) + 1.5))
        for row, one in enumerate(shown):
            share, color = used_share(one), COLORS[profiles.index(one.profile) % len(COLORS)]
            solid = one.state == KEPT or one.state in BROKEN
            face = color if solid else "white"
            axes.barh(row, share, 0.62, color=face, edgecolor=color, hatch="" if solid else "////", linewidth=0.8)
            text = f"{value_text(one)}, {limit_text(one)}: {one.state}"
            weight = "bold" if one.state in BROKEN else "normal"
            axes.text(max(share, 1.0) + 0.03, row, text, va="center", fontsize=8.5, color=INK, fontweight=weight)
        axes.axvline(1.0, color=INK, linewidth=1.2)
        labels = [f"{one.text[:66]}  {one.check}, {one.clause}" for one in shown]
        axes.set_yticks(range(len(shown)), labels, fontsize=8.5)
        axes.set(xlim=(0.0, 3.0), ylim=(len(shown) - 0.4, -0.6), xlabel="used share of the limit")
        axes.xaxis.label.set(x=0.165)
        axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0])
        axes.grid(visible=False, axis="y")
        for row, (one, after) in enumerate(pairwise(shown)):
            if topic_of(one.quantity) != topic_of(after.quantity):
                axes.axhline(row + 0.5, color=QUIET, linewidth=0.4)
        patches = [Patch(color=color, label=name) for color, name in zip(COLORS, profiles, strict=False)]
        patches.append(Patch(facecolor="white", edgecolor=QUIET, hatch="////", label="not decided"))
        axes.legend(handles=patches, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(patches), borderaxespad=0.2)
        figure.suptitle(title, x=0.012, ha="left", fontweight="bold", fontsize=13.0)
        figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.99))
        figure.savefig(path)
        plt.close(figure)
    return True
