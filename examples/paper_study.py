#!/usr/bin/env python3
"""Study the numerical example of Seo, Jung, Han and Park (2004) on several meshes and with both elastic models.

A carriage of two rods slides down a very flexible cable. Written are, into one directory:

    behaviour.png    cable and both bodies at a row of times, as the paper's Fig. 5 studies them
    path.png         path of Point 1 for every mesh and model, as its Fig. 6 studies it, and the distance to a
                     reference on a fine mesh
    MODEL.rrd        the motion on the finest of the meshes for rerun, one recording for each elastic model

Where Point 1 is at 0.5, 1.0, 1.5 s and so on is printed. Geometry, initial condition and Point 1 are not stated in the
paper but drawn only; here they are a declared reconstruction, and the curves of Fig. 5 or 6 are not claimed to be
reproduced.

    python examples/paper_study.py --output paper_study
"""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import sys
import textwrap
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl

mpl.use("Agg")  # no screen needed

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from cable_twin import Simulation, Snapshot, load_scenario
from cable_twin.frame.records import BodyState, FloatArray
from cable_twin.geometry.bodies import body_outlines
from cable_twin.scenario import Scenario, ScenarioError
from cable_twin.simulation import EquilibriumError, SolverError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cable_twin.view.rerun_view import RerunView

DONE, FAILED = 0, 1  # exit codes; argparse ends with 2
MODELS = {"continuum": "continuum (default)", "element_frame": "element frame (the paper's)"}
CARRIAGE = "carriage"
REFERENCE_ELEMENTS = 96  # within 3 mm of 192 and 384 elements and a quarter of the step, for 2 s
FRAME = 0.005  # s between two snapshots
TABLE_INTERVAL = 0.5  # s
PLANE = [0, 2]  # x and z of a position
POSES = 5  # of cable and bodies in behaviour.png

STATEMENT = (
    "Geometry, initial condition and Point 1 (taken as the sliding joint) are a declared reconstruction, because the "
    "paper shows them in pictures only. This is the same study; it does not claim to reproduce Fig. 5 or Fig. 6 of "
    "Seo, Jung, Han and Park (2004)."
)
EPILOG = "exit codes: 0 all is written, 1 a run or a file failed, 2 wrong arguments"

INK = "#22303C"
QUIET = "#7B8794"
GRID = "#E3E8EC"
MESH_COLORS = ("#E69F00", "#009E73", "#0072B2", "#CC79A7", "#D55E00", "#56B4E9")  # apart for colour-blind eyes too
MESH_DASHES: tuple[tuple[float, ...], ...] = ((2.2, 1.4), (5.0, 1.6), (), (7.0, 1.5, 1.5, 1.5), (1.0, 1.2), (9.0, 2.0))
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": QUIET,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.titlesize": 11.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "savefig.dpi": 130,
}


@dataclass(slots=True)
class Run:
    """Simulated run of one mesh with one elastic model."""

    model: str
    elements: int
    scenario: Scenario
    times: FloatArray  # (n,) s
    path: FloatArray  # (n, 2) m, of Point 1
    poses: list[Snapshot]  # at the times that behaviour.png shows


def simulate(model: str, elements: int, times: FloatArray, progress: Progress, rrd: Path | None = None) -> Run:
    """Simulate one mesh with one elastic model.

    Args:
        model: `cable.elastic_model` of the scenario.
        elements: `cable.elements` of the scenario.
        times: (n,) s, at which Point 1 is read.
        progress: Shows how far it is.
        rrd: Recording to write, or None.

    Raises:
        ScenarioError, EquilibriumError, SolverError, OSError: The run failed.
    """
    task = progress.add_task(f"{model}, {elements} elements", total=float(times[-1]))
    scenario = load_scenario("seed_example", {"cable.elastic_model": model, "cable.elements": elements})
    simulation = Simulation(scenario)
    shown = {int(index) for index in np.linspace(0, len(times) - 1, POSES).round()}
    path, poses = np.empty((len(times), 2)), []
    with contextlib.ExitStack() as stack:
        view = None if rrd is None else stack.enter_context(contextlib.closing(_view(scenario, rrd)))
        for index, time in enumerate(times):
            snapshot = simulation.advance_to(float(time))
            path[index] = snapshot.carriages[CARRIAGE].position[PLANE]
            if index in shown:
                poses.append(snapshot)
            if view is not None:
                view.log(snapshot)
            progress.update(task, completed=float(time))
    return Run(model, elements, scenario, times, path, poses)


def _view(scenario: Scenario, path: Path) -> RerunView:
    """Open a recording of the scenario at `path`."""
    from cable_twin.view.rerun_view import RerunView  # noqa: PLC0415 - half a second

    outlines = body_outlines(scenario)
    title = f"Seo et al. (2004), a declared reconstruction: {scenario.cable.elastic_model}, "
    name, rate = f"{title}{scenario.cable.elements} elements", 1.0 / FRAME
    return RerunView(name, outlines, path=path, live=False, geometry_rate=rate, rope_rate=rate)


def draw_behaviour(runs: list[Run], path: Path) -> None:
    """Draw cable and bodies at a row of times, one panel for each elastic model, and save the figure."""
    figure, panels = plt.subplots(1, len(runs), figsize=(12.4, 6.4), sharex=True, sharey=True, squeeze=False)
    colors = mpl.colormaps["viridis"](np.linspace(0.0, 0.86, POSES))
    for axes, run in zip(panels[0], runs, strict=True):
        axes.plot(*run.path.T, color=QUIET, lw=1.0, dashes=(1.0, 2.0), zorder=2)
        for color, snapshot in zip(colors, run.poses, strict=True):
            _draw_pose(axes, run.scenario, snapshot, color)
        ends = run.poses[0].cable.positions[[0, -1]][:, PLANE]
        axes.plot(*ends.T, ls="", marker="^", ms=9, color=INK, zorder=8)
        axes.set_aspect("equal")
        axes.margins(0.04, 0.05)
        axes.set_title(MODELS[run.model])
        axes.set_xlabel("x [m]")
    panels[0, 0].set_ylabel("z [m]")
    handles = [
        plt.Line2D([], [], color=color, lw=3.0, label=f"{snapshot.time:g} s")
        for color, snapshot in zip(colors, runs[0].poses, strict=True)
    ]
    handles += [
        plt.Line2D([], [], color=INK, lw=1.4, label="cable"),
        plt.Line2D([], [], color=INK, lw=4.0, solid_capstyle="round", label="RB1"),
        plt.Line2D([], [], color=INK, lw=4.0, alpha=0.55, solid_capstyle="round", label="RB2"),
        plt.Line2D([], [], color=QUIET, lw=1.0, dashes=(1.0, 2.0), label="path of Point 1"),
    ]
    title = f"A carriage of two bodies slides down a very flexible cable: {runs[0].elements} elements"
    _finish(figure, title, handles, "Both axes in metres and to the same scale.", path)


def _draw_pose(axes: Axes, scenario: Scenario, snapshot: Snapshot, color: FloatArray) -> None:
    """Draw cable, joint and bodies at one moment."""
    carriage = snapshot.carriages[CARRIAGE]
    after = int(np.searchsorted(snapshot.cable.arc_lengths, carriage.arc_length))
    cable = np.insert(snapshot.cable.positions, after, carriage.position, axis=0)[:, PLANE]
    axes.plot(*cable.T, color=color, lw=1.4, zorder=3)
    for index, (name, body) in enumerate(scenario.carriages[CARRIAGE].bodies.items()):
        # A rod, from its pivot through its centre of mass to where the next body hangs or as far again.
        top = np.array(body.upper_pivot)
        bottom = -top if body.lower_pivot is None else np.array(body.lower_pivot)
        rod = _place(np.array([top, bottom]), carriage.bodies[name])
        alpha = 1.0 if index == 0 else 0.55
        axes.plot(*rod.T, color=color, lw=4.0, alpha=alpha, solid_capstyle="round", zorder=4)
        axes.plot(*rod[0], marker="o", ms=5.5, mfc="white", mec=color, mew=1.5, zorder=6)
    axes.annotate(
        f"{snapshot.time:g} s",
        rod[0],
        xytext=(-8, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        color=color,
        weight="bold",
        zorder=7,
    )


def _place(points: FloatArray, body: BodyState) -> FloatArray:
    """Points (n, 2) in m, x and z, of points in a body's axes; pitch turns x towards -z."""
    cos, sin = np.cos(body.pitch), np.sin(body.pitch)
    return np.array([body.x, body.z]) + points @ np.array([(cos, -sin), (sin, cos)])


def draw_paths(runs: list[Run], reference: Run, path: Path) -> None:
    """Draw the path of Point 1 and its distance to the reference, a column for each elastic model, and save it."""
    figure, panels = plt.subplots(
        2, len(MODELS), figsize=(12.4, 7.6), sharex="row", sharey="row", height_ratios=[1.25, 1.0], squeeze=False
    )
    meshes = sorted({run.elements for run in runs})
    looks = {
        mesh: {"color": MESH_COLORS[index % len(MESH_COLORS)], "dashes": MESH_DASHES[index % len(MESH_DASHES)]}
        for index, mesh in enumerate(meshes)
    }
    ticks = _table_times(reference.times)
    for column, model in enumerate(MODELS):
        upper, lower = panels[:, column]
        upper.plot(*reference.path.T, color=INK, lw=4.5, alpha=0.25, solid_capstyle="round", zorder=2)
        marks = reference.path[ticks]
        upper.plot(*marks.T, ls="", marker="o", ms=5.0, color=INK, zorder=5)
        for time, mark in zip(reference.times[ticks], marks, strict=True):
            upper.annotate(
                f"{time:g} s",
                mark,
                xytext=(0, -10),
                textcoords="offset points",
                ha="center",
                va="top",
                fontsize=9,
                zorder=6,
                bbox={"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.85},
            )
        for run in runs:
            if run.model == model:
                upper.plot(*run.path.T, lw=1.6, zorder=4, **looks[run.elements])
                apart = 1e3 * np.hypot(*(run.path - reference.path).T)
                lower.plot(run.times, apart, lw=1.6, **looks[run.elements])
        upper.set_title(MODELS[model])
        upper.set_xlabel("x [m]")
        upper.margins(0.05, 0.14)
        lower.set_xlabel("time [s]")
        lower.set_xlim(0.0, reference.times[-1])
        lower.set_ylim(bottom=0.0)
    panels[0, 0].set_ylabel("z [m]")
    panels[1, 0].set_ylabel("distance to the reference [mm]")
    handles = [plt.Line2D([], [], lw=1.6, label=f"{mesh} elements", **looks[mesh]) for mesh in meshes]
    label = f"reference: {reference.model}, {reference.elements} elements"
    handles.append(plt.Line2D([], [], color=INK, lw=4.5, alpha=0.25, label=label))
    note = (
        "Above: z is drawn larger than x, dots are the reference. Below: distance at the same time. Compared with "
        "finer meshes and steps, the reference is within 3 mm over 2 s."
    )
    _finish(figure, "Path of Point 1, the sliding joint, on several meshes", handles, note, path)


def _finish(figure: Figure, title: str, handles: list, note: str, path: Path) -> None:
    """Add title, legend and caption around the panels and save the figure."""
    height = figure.get_figheight()
    figure.text(0.012, 1.0 - 0.12 / height, title, ha="left", va="top", fontsize=14, weight="bold")
    figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0.005, 1.0 - 0.38 / height),
        ncols=len(handles),
        handlelength=2.6,
        columnspacing=1.6,
    )
    caption = textwrap.fill(f"{note} {STATEMENT}", 185)
    figure.text(0.012, 0.12 / height, caption, ha="left", va="bottom", fontsize=9, color="#4A5763", linespacing=1.4)
    figure.tight_layout(rect=(0.0, 0.72 / height, 1.0, 1.0 - 0.7 / height), w_pad=2.0)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    plt.close(figure)
    with Image.open(buffer) as picture:  # lines need no more than a palette, a third of the size
        picture.convert("RGB").quantize(256).save(path, optimize=True)


def _table_times(times: FloatArray) -> list[int]:
    """Indices of the printed times: every half second and the last."""
    every = round(TABLE_INTERVAL / FRAME)
    return [*range(every, len(times) - 1, every), len(times) - 1]


def table(runs: list[Run], reference: Run) -> str:
    """Place of Point 1 and its distance from the reference, a line for each run and time."""
    lines = [f"{'elastic model':<15}{'elements':>8}{'time [s]':>10}{'x [m]':>10}{'z [m]':>10}{'distance [mm]':>15}"]
    lines.append("-" * len(lines[0]))
    for run in [reference, *runs]:
        for index in _table_times(run.times):
            x, z = run.path[index]
            apart = (
                "reference" if run is reference else f"{1e3 * math.dist(run.path[index], reference.path[index]):.2f}"
            )
            lines.append(f"{run.model:<15}{run.elements:>8}{run.times[index]:>10.3g}{x:>10.4f}{z:>10.4f}{apart:>15}")
    return "\n".join(lines)


def study(elements: list[int], duration: float, output: Path, *, recordings: bool = True) -> list[Path]:
    """Run every mesh with both models and print the table; returns the written files.

    Args:
        elements: Meshes.
        duration: s.
        output: Directory for the files.
        recordings: Whether .rrd files are written too.

    Raises:
        ScenarioError, EquilibriumError, SolverError, OSError: A run or a file failed.
    """
    output.mkdir(parents=True, exist_ok=True)
    times = np.append(np.arange(0.0, duration - 0.5 * FRAME, FRAME), duration)
    finest = max(elements)
    files = [output / "behaviour.png", output / "path.png"]
    columns = (TextColumn("{task.description:<30}"), BarColumn(), TextColumn("{task.completed:.2f} s simulated"))
    runs = []
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True)) as progress:
        for model, mesh in product(MODELS, sorted(set(elements))):
            rrd = output / f"{model}.rrd" if recordings and mesh == finest else None
            runs.append(simulate(model, mesh, times, progress, rrd))
            files += [rrd] if rrd is not None else []
        reference = simulate("continuum", REFERENCE_ELEMENTS, times, progress)
    with plt.rc_context(STYLE):
        draw_behaviour([run for run in runs if run.elements == finest], files[0])
        draw_paths(runs, reference, files[1])
    print(textwrap.fill(STATEMENT, 100), table(runs, reference), sep="\n\n", end="\n\n")
    return files


def _duration(text: str) -> float:
    """Parse a duration in s."""
    value = float(text)
    if not FRAME * POSES <= value <= 60.0:
        raise argparse.ArgumentTypeError(f"{text} s given, allowed are {FRAME * POSES:g} to 60 s")
    return value


def _elements(text: str) -> int:
    """Parse a number of elements."""
    value = int(text)
    if not 4 <= value < REFERENCE_ELEMENTS:
        raise argparse.ArgumentTypeError(
            f"{text} given, allowed are 4 to {REFERENCE_ELEMENTS - 1}; {REFERENCE_ELEMENTS} are the reference"
        )
    return value


def main() -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--output", type=Path, default=Path("paper_study"), metavar="DIR", help="default: paper_study")
    parser.add_argument("--duration", type=_duration, default=2.0, metavar="S", help="simulated time; default: 2.0")
    parser.add_argument(
        "--elements", type=_elements, nargs="+", default=[12, 18, 24], metavar="N", help="meshes; default: 12 18 24"
    )
    parser.add_argument("--no-rerun", action="store_true", help="write no .rrd files")
    options = parser.parse_args()
    try:
        files = study(options.elements, options.duration, options.output, recordings=not options.no_rerun)
    except (ScenarioError, EquilibriumError, SolverError, OSError) as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return FAILED
    for file in files:
        print(file)
    return DONE


if __name__ == "__main__":
    sys.exit(main())
