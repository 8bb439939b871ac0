"""Plot of a static line: terrain and profile, plan, tension over arc length, clearance and tower loads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from textwrap import wrap
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from cable_twin.frame.records import FloatArray, Place
from cable_twin.frame.snapshot import Layout
from cable_twin.geometry.ground import heights_over_ground, tower_foot
from cable_twin.key_figures import FigureId
from cable_twin.offline.lines.at_rest import Line
from cable_twin.offline.plots import ASIDE, COLORS, INK, MANY, QUIET, save, styled
from cable_twin.view.labels import above_line, highest_line, shared_names

LIMIT = "#C0392B"
X_LABEL = "x, along the track [m]"
BARS: tuple[dict[str, Any], ...] = (  # of the ranges of loads downwards and along the track
    {"linewidth": 4.0, "marker": "_", "markersize": 5.0},
    {"linewidth": 1.2, "marker": "x", "markersize": 3.0},
)
BESIDE = 6.0  # points between such bars of one place
SAMPLES = 400  # of x, at which the clearance of ropes is drawn
MOST_NAMES, LONGEST_NAME = 24, 24  # of towers, above which none is written, and letters in a line of a name
LETTER, ROW = 0.008, 0.06  # mean width of a letter of these names and height of a line, over those of the panel
HEAD: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.0}


def write_line_plot(line: Line, path: Path) -> None:
    """Draw a calculated line into a file, with a format by its suffix.

    Raises:
        OSError: the file cannot be written.
    """
    panels = [_profile, _tension]
    if _sideways(line) > ASIDE:
        panels.insert(1, _plan)
    if line.scenario.terrain:
        panels.append(_clearance)
    if line.scenario.towers:
        panels.append(_towers)
    with styled():
        ratios = [1.6, *(1.0 for _ in panels[1:])]
        size = 10.0, 2.4 * sum(ratios) + 0.6
        figure, rows = plt.subplots(len(panels), 1, figsize=size, height_ratios=ratios, squeeze=False)
        for draw, axes in zip(panels, rows[:, 0], strict=True):
            draw(axes, line)
            axes.margins(x=0.01)
        where = f"{line.moved} at {line.places.size} places" if line.moved else "no vehicle"
        save(figure, f"{line.scenario.name} at rest, {where}", path)


def _profile(axes: Axes, line: Line) -> None:
    """Draw the profile of a line: ropes and bodies with the vehicle at all places, terrain and towers."""
    ropes = np.array([columns.rope_position for columns in line.columns])
    for number, rope in enumerate(ropes):
        for part in _layout(line).ropes.values():
            called = "rope" if number == part.start == 0 else ""
            axes.plot(rope[part, 0], rope[part, 2], color=COLORS[0], linewidth=0.4, label=called)
    bodies = np.array([columns.body_position for columns in line.columns])
    here = np.array([np.repeat(columns.attached > 0.0, np.diff(_layout(line).first_body)) for columns in line.columns])
    if here.any():
        axes.plot(bodies[..., 0][here], bodies[..., 2][here], ".", color=COLORS[1], markersize=2.5, label="vehicles")
    if line.scenario.terrain:
        ground = np.array(line.scenario.terrain)
        axes.plot(ground[:, 0], ground[:, -1], color=INK, label="terrain")
        axes.fill_between(ground[:, 0], ground[:, -1], ground[:, -1].min() - 10.0, color=QUIET, alpha=0.15, linewidth=0)
    for number, (x, _, top) in enumerate(line.scenario.tower_places.values()):
        foot = tower_foot(line.scenario, x, top, ropes[:, :, 2])
        axes.plot([x, x], [foot, top], color=QUIET, linewidth=2.5, label="" if number else "towers")
    _name_towers(axes, line, [rope[part][:, [0, 2]] for rope in ropes for part in _layout(line).ropes.values()])
    axes.set_xlabel(X_LABEL)
    axes.set_ylabel("z, height [m]")
    axes.legend(ncols=4, **HEAD)


def _name_towers(axes: Axes, line: Line, ropes: Sequence[FloatArray]) -> None:
    """Write the names of the towers of a line above the ropes, given as points (n, 2) of a vertical plane in m."""
    tops: dict[float, float] = {}
    for x, _, top in line.scenario.tower_places.values():
        tops[x] = max(top, tops.get(x, top))
    names = {name: (place[0],) for name, place in line.scenario.tower_places.items()}
    shared = shared_names(names, {}, list(line.scenario.cables))
    if not 0 < len(shared) <= MOST_NAMES:
        return
    upper, (low, high), row = highest_line(ropes), axes.get_xlim(), ROW * float(np.ptp(axes.get_ylim()))
    for name, (x,) in shared.items():
        lines = wrap(name, LONGEST_NAME)
        width = LETTER * max(map(len, lines)) * (high - low)
        share, height = above_line(np.array([x, tops[x]]), width, upper, (low, high))
        side = {0.0: "left", 0.5: "center", 1.0: "right"}[share]
        axes.update_datalim([(x, height + row * len(lines))])
        axes.annotate(
            "\n".join(lines), (x, height), (0.0, 4.0), textcoords="offset points", ha=side, va="bottom", fontsize=8.0
        )
    axes.autoscale_view()


def _sideways(line: Line) -> float:
    """Largest distance (m) of ropes, bodies and towers of a line from its vertical plane."""
    if line.scenario.dim == 2:
        return 0.0
    towers = [y for _, y, _ in line.scenario.tower_places.values()]
    places = [y for columns in line.columns for y in (columns.rope_position[:, 1], columns.body_position[:, 1])]
    return float(np.abs(np.concatenate([*places, towers])).max())


def _plan(axes: Axes, line: Line) -> None:
    """Draw the plan view of a line: ropes, vehicles and towers from above."""
    for number, columns in enumerate(line.columns):
        rope = columns.rope_position
        for part in _layout(line).ropes.values():
            called = "rope" if number == part.start == 0 else ""
            axes.plot(rope[part, 0], rope[part, 1], color=COLORS[0], linewidth=0.4, label=called)
        here = np.repeat(columns.attached > 0.0, np.diff(_layout(line).first_body))
        places = columns.body_position[here]
        axes.plot(places[:, 0], places[:, 1], ".", color=COLORS[1], markersize=2.5, label="" if number else "vehicles")
    towers = np.array(list(line.scenario.tower_places.values())).reshape(-1, 3)
    axes.plot(towers[:, 0], towers[:, 1], "s", color=QUIET, markersize=5.0, label="towers")
    axes.set_xlabel(X_LABEL)
    axes.set_ylabel("y, to the left [m]")
    axes.legend(ncols=3, **HEAD)


def _tension(axes: Axes, line: Line) -> None:
    """Draw least and highest tension of the ropes of a line over arc length, with the limits by safety factors."""
    dashes = cycle(("-", "-.", ":"))
    arc = _layout(line).arc_lengths
    tensions = 1e-3 * np.array([columns.rope_tension for columns in line.columns])
    low, high = tension_envelope(line, tensions)
    for number, (rope, part) in enumerate(_layout(line).ropes.items()):
        color, whose = COLORS[number % len(COLORS)], f"{rope}, " if line.scenario.ropes else ""
        if not line.moved:
            axes.plot(arc[part], high[part], color=color, label=rope if line.scenario.ropes else "rope")
            continue
        axes.fill_between(arc[part], low[part], high[part], color=color, alpha=0.2, linewidth=0)
        axes.plot(arc[part], high[part], color=color, label=f"{whose}highest")
        axes.plot(arc[part], low[part], color=color, linestyle="--", label=f"{whose}lowest")
    for limit, names in tension_limits(line).items():
        axes.axhline(limit, color=LIMIT, linewidth=1.0, linestyle=next(dashes), label=names)
    axes.set_xlabel("arc length of the rope, unstrained [m]")
    axes.set_ylabel("tension [kN]")
    axes.legend(ncols=4, **HEAD)


def tension_envelope(line: Line, tensions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and highest rope tension (samples,) over calculated places of the vehicle and interpolated ones between.

    Tension jumps at a vehicle. At a place, the tension on each side of the vehicle is extrapolated from the two
    samples there; between places, where the vehicle passes all samples, the tensions change linearly.

    Args:
        line: calculated line.
        tensions: (places, samples) at all places, in the unit of the result.
    """
    layout, low, high = _layout(line), tensions.min(axis=0), tensions.max(axis=0)
    for rope, places, on in _loads(line):
        part = layout.ropes[rope]
        arc, own = layout.arc_lengths[part], tensions[:, part]
        sides = np.array([_sides(arc, *pair) for pair in zip(own, places, strict=True)])
        for first in range(len(places) - 1):
            here, there = places[first : first + 2]
            if not (on[first] and on[first + 1]) or here == there:
                continue
            passed = np.flatnonzero((arc >= min(here, there)) & (arc <= max(here, there)))
            share = (arc[passed] - here) / (there - here)
            between = sides[first] + share[:, None] * (sides[first + 1] - sides[first])
            passed += part.start
            low[passed] = np.minimum(low[passed], between.min(axis=1))
            high[passed] = np.maximum(high[passed], between.max(axis=1))
    return low, high


def _loads(line: Line) -> Iterator[tuple[str, FloatArray, NDArray[np.bool_]]]:
    """Yield each rope with a vehicle at which tension jumps: name, arc lengths (places,) in m, mask of valid places.

    A vehicle counts on the rope that carries it and on the haul ropes to which it is clamped.
    """
    layout = _layout(line)
    for vehicle, name in enumerate(layout.vehicles):
        at = np.array([c.arc_length[vehicle] for c in line.columns])
        ropes = np.array([c.vehicle_rope[vehicle] if c.attached[vehicle] > 0.0 else np.nan for c in line.columns])
        for number, rope in enumerate(layout.ropes):
            yield rope, at, ropes == number
        clamps = line.scenario.carriages[name].clamped_to if name in line.scenario.carriages else {}
        for rope, place in clamps.items():  # it goes with the material of the rope
            yield rope, place + (line.places if line.moved in line.scenario.drives else 0.0 * at), ~np.isnan(ropes)


def _sides(arc: FloatArray, tension: FloatArray, place: float) -> tuple[float, float]:
    """Rope tension on both sides of an arc length (m), each extrapolated from the two samples there."""
    after = int(np.clip(np.searchsorted(arc, place), 1, arc.size - 1))
    found = []
    for one, other in ((max(after - 2, 0), after - 1), (after, min(after + 1, arc.size - 1))):
        slope = (tension[other] - tension[one]) / (arc[other] - arc[one]) if other > one else 0.0
        found.append(float(tension[one] + slope * (place - arc[one])))
    return found[0], found[1]


def tension_limits(line: Line) -> dict[float, str]:
    """Allowed tensions (kN) by the safety factors of ropes, each with a label of factor and rope names."""
    shared: dict[tuple[float, float], list[str]] = {}
    for name, rope in line.scenario.cables.items():
        factor = FigureId("rope_safety_factor", f"ropes.{name}", "lowest")
        allowed = next((one.limit for one in line.figures if one.id == factor), None)
        if allowed is not None and rope.breaking_force is not None:
            shared.setdefault((1e-3 * rope.breaking_force / allowed, allowed), []).append(name)
    return {
        limit: f"safety factor of {factor:g}" + (f", {', '.join(names)}" if line.scenario.ropes else "")
        for (limit, factor), names in shared.items()
    }


def _clearance(axes: Axes, line: Line) -> None:
    """Draw the least height above the ground over x, of each rope and of the vehicles of a line."""
    scenario, layout = line.scenario, _layout(line)
    several = len(layout.ropes) > 1
    for (name, part), dashes in zip(layout.ropes.items(), cycle(("-", "--", ":", "-."))):
        points = np.array([columns.rope_position[part] for columns in line.columns])
        x = np.linspace(points[..., 0].min(), points[..., 0].max(), SAMPLES)
        found = []
        for rope in points:
            order = np.argsort(rope[:, 0])
            heights = heights_over_ground(scenario, rope)
            found.append(np.interp(x, rope[order, 0], heights[order], left=np.nan, right=np.nan))
        label = f"{name}: rope" if several else "rope"
        axes.plot(x, np.fmin.reduce(found), color=COLORS[0], linestyle=dashes, label=label)
    carriers = scenario.carriers
    groups: dict[str, list[Place]] = {}
    for seen in line.lowest:
        for name, place in seen.items():
            group = carriers.name if carriers is not None and name not in scenario.carriages else name
            groups.setdefault(group, []).append(place)
    for (name, places), marker in zip(groups.items(), cycle(".x+")):
        at = [place.x for place in places], [place.height for place in places]
        axes.plot(*at, marker, color=COLORS[1], markersize=4.0, label=name)
    limits = (scenario.limits.rope_clearance, "-"), (scenario.limits.vehicle_clearance, "--")
    for limit, dashes in limits:
        if limit is not None:
            axes.axhline(limit, color=LIMIT, linewidth=1.0, linestyle=dashes)
    axes.plot([], [], color=LIMIT, linewidth=1.0, label="limit")
    axes.set_xlabel(X_LABEL)
    axes.set_ylabel("clearance over\nthe terrain [m]")
    axes.legend(ncols=4, **HEAD)


def _towers(axes: Axes, line: Line) -> None:
    """Draw both load components of each tower of a line over the place of the vehicle, or over the towers.

    They stand over the towers, as ranges over all places, where there are many towers or no vehicle.
    """
    towers = list(line.scenario.towers)
    down, along = (
        {name: 1e-3 * line.rows[f"{name}: load {part} [N]"] for name in towers}
        for part in ("downwards", "along the track")
    )
    over_places = line.moved and len(towers) <= MANY
    if over_places:
        for color, name in zip(COLORS, towers, strict=False):
            axes.plot(line.places, down[name], color=color, label=f"{name}, downwards")
            axes.plot(line.places, along[name], color=color, linestyle="--")
        axes.plot([], [], color=QUIET, linestyle="--", label="along the track")
    else:
        _tower_ranges(axes, line, (down, along))
    if line.scenario.limits.support_load is not None:
        axes.axhline(1e-3 * line.scenario.limits.support_load, color=LIMIT, linewidth=1.0, label="limit")
    axes.set_xlabel(_where(line) if over_places else X_LABEL)
    axes.set_ylabel("load of the rope\non towers [kN]")
    axes.legend(ncols=4, **HEAD)


def _tower_ranges(axes: Axes, line: Line, loads: Sequence[Mapping[str, FloatArray]]) -> None:
    """Draw the range of the loads (kN) downwards and along the track of each tower as bars at the towers, by rope."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    ropes = [name for name in line.scenario.cables if line.scenario.of_rope(name).towers]
    colors = {name: COLORS[number % len(COLORS)] for number, name in enumerate(ropes)}
    looks = [(rope, part) for rope in ropes for part in range(len(loads))]
    for place, (rope, part) in enumerate(looks):
        aside = BESIDE * (place - 0.5 * (len(looks) - 1)) / 72.0  # inches, bars stand beside each other
        moved, color = ScaledTranslation(aside, 0.0, figure.dpi_scale_trans), colors[rope]
        for tower in line.scenario.of_rope(rope).towers:
            x, values = line.scenario.tower_places[tower][0], loads[part][tower]
            ends = np.array([values.min(), values.max()])
            axes.update_datalim([(x, end) for end in ends])
            axes.plot([x, x], ends, transform=axes.transData + moved, color=color, solid_capstyle="butt", **BARS[part])
    if line.scenario.ropes:
        for name, color in colors.items():
            axes.plot([], [], color=color, linewidth=BARS[0]["linewidth"], label=name)
    for name, look in zip(("downwards", "along the track"), BARS, strict=True):
        axes.plot([], [], color=INK, label=name, **look)
    rope_x = line.columns[0].rope_position[:, 0]
    axes.update_datalim([(rope_x.min(), 0.0), (rope_x.max(), 0.0)])  # to stand below the profile
    axes.autoscale_view()


def _where(line: Line) -> str:
    """Axis label for the places of the vehicle."""
    carriers = line.scenario.carriers
    if line.moved in line.scenario.drives or (carriers is not None and line.moved == carriers.name):
        return "rope travel [m]"
    return f"arc length of {line.moved} [m]"


def _layout(line: Line) -> Layout:
    return Layout.of(line.scenario, line.columns[0].rope_tension.size // max(len(line.scenario.ropes), 1))
