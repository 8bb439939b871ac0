"""Forecaster of a running twin: futures forked from its state into members of an ensemble, and run ahead of it."""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Sequence

import numpy as np

from cable_twin.ensemble.ensemble import Ensemble
from cable_twin.frame.records import AppliedCommand, Command, CommandError
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import FigureId, KeyFigure, KeyFigures
from cable_twin.key_figures.outlook import ANNOUNCED, AS_COMMANDED, EMERGENCY_STOP, LEFT_OUT, SHOWN, Future, Outlook
from cable_twin.mechanics.language.declared import Memory
from cable_twin.mechanics.parameters import FloatArray, IntArray
from cable_twin.scenario import Scenario, wind_unfelt
from cable_twin.simulation import SAMPLES, Simulation
from cable_twin.simulation.command_handlers import GUST_DURATION, check_ahead

HORIZON, LONGEST = 60.0, 3600.0  # s
LOOK = 0.1  # s between two looks at the key figures of a future, as long as drives stop and what that stirs is new
EARLY, SELDOM = 10.0, 2  # s from which on there are that many times fewer looks
CHECK = 2.0  # s between two moments among which the time is found from which on a limit is not kept
GUST = 10.0  # m/s, of the announced gust where nothing is announced; assumed: a squall that no wind alarm foretells
WINDS = ("gust", "operating_gust", "wind")  # kinds of commands that can be announced
NAMES = (EMERGENCY_STOP, AS_COMMANDED, ANNOUNCED)
SOURCE = "outlook"  # of assumed commands


def standard_gust(scenario: Scenario, speed: float = GUST) -> Command:
    """Command of a 1 - cosine gust with an amplitude (m/s), across the track in space, along the track in a plane."""
    along, across = (0.0, speed) if scenario.dim == 3 else (speed, 0.0)
    return Command("gust", {"x": along, "y": across, "z": 0.0, "duration": GUST_DURATION})


class Forecaster:
    """Simulator of a twin's futures from any state: with an emergency stop now, as commanded, and with a gust or wind.

    Each future is bit-equal to a simulation that goes on from the same state with the same commands.

    Args:
        scenario: of the twin.
        horizon: length of the futures (s).
        look: simulated time (s) between two looks at the key figures, to the nearest whole solver step; after 10 s
            twice as long.
        samples: points of each rope in a snapshot, for clearances and sag.
        threads: of the ensemble; None for one a core.

    Raises:
        ValueError: the horizon or the time between looks is out of range; one line.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        horizon: float = HORIZON,
        look: float = LOOK,
        samples: int = SAMPLES,
        threads: int | None = None,
    ) -> None:
        for name, value in (("horizon", horizon), ("look", look)):
            if not 0.0 < value <= LONGEST:
                raise ValueError(f"outlook: {name}: given {value!r} s; allowed: more than 0 to {LONGEST:g} s")
        self.horizon, self._look, self._scenario = horizon, look, scenario
        self._ensemble = Ensemble(scenario, len(NAMES), samples=samples, threads=threads, progress=False)
        self._rest = self._ensemble.snapshot(0)

    def outlook(self, simulation: Simulation, announced: Command | None = None) -> Outlook:
        """Run the futures from the present state of a simulation, which stays as it is.

        Args:
            simulation: of the scenario.
            announced: gust, operating gust or wind that is assumed to come now; None for a gust of 10 m/s.

        Raises:
            CommandError: the announced command is no wind, or beyond what a command may ask for.
            ValueError: the simulation is of another scenario.
        """
        begun, now, ensemble = time.perf_counter(), simulation.time, self._ensemble
        commands = self._commands(simulation, announced)
        ensemble.fork(simulation)
        texts = [text for _, text in commands]
        runs = [_Run(self._scenario, self._rest, *named) for named in zip(NAMES, texts, strict=True)]
        for member, (run, (command, text)) in enumerate(zip(runs, commands, strict=True)):
            run.take(ensemble.snapshot(member))
            if command is not None:
                try:
                    ensemble.apply(command, member)
                    run.figures.command(AppliedCommand(now, command, SOURCE))
                except CommandError as error:  # by the present motion, as of a gust while another one lasts
                    run.fault = str(error).removeprefix(f"member {member}: ")
            elif run.name == ANNOUNCED:
                run.fault = text
        not_run = {member for member, run in enumerate(runs) if run.fault}
        checked = now
        for moment in self._moments(now, simulation.step).tolist():
            going = [member for member in range(len(runs)) if member not in not_run | ensemble.faults.keys()]
            ensemble.advance_to([moment if member in going else now for member in range(len(runs))])
            snapshots, due = ensemble.snapshots(), moment > checked + CHECK - 0.5 * self._look
            checked = moment if due else checked
            for member in going:
                runs[member].take(snapshots[member])
                if due:
                    runs[member].note()
        for member, line in ensemble.faults.items():
            runs[member].fault = line
        futures = tuple(run.future(run=member not in not_run) for member, run in enumerate(runs))
        return Outlook(now, self.horizon, futures, tuple(self._scenario.cables), time.perf_counter() - begun)

    def close(self) -> None:
        """End the threads of the ensemble."""
        self._ensemble.close()

    def _commands(self, simulation: Simulation, announced: Command | None) -> list[tuple[Command | None, str]]:
        """Command of each future (None for none), and its assumption in words."""
        stop: tuple[Command | None, str] = Command("emergency_stop", {}), "emergency stop now"
        if simulation.emergency_stopped:
            stop = None, "emergency stop, already in force"
        commands = [stop, (None, "drives go on as commanded, wind as it is and as the scenario has it")]
        if announced is None:
            if unfelt := wind_unfelt(self._scenario):
                return [*commands, (None, f"no gust is looked at: {unfelt}")]
            announced = standard_gust(self._scenario)
        if announced.kind not in WINDS:
            raise CommandError(f"announced: given {announced.kind!r}; allowed: {', '.join(WINDS)}")
        check_ahead(self._scenario, announced, stopped=False)
        values = ", ".join(f"{key} {value:g}" for key, value in announced.values.items())
        kind = announced.kind.replace("_", " ")
        return [*commands, (announced, f"as commanded, with a {kind} from now on: {values} (m/s, duration in s)")]

    def _moments(self, now: float, step: float) -> FloatArray:
        """Times (n,) in s at which the key figures of the futures are updated, the last one at the horizon."""
        steps = max(round(self._look / step), 1)
        total = max(round(self.horizon / step), 1)
        early = min(max(round(EARLY / step) // steps, 1) * steps, total)
        clocks = np.concatenate([np.arange(steps, early, steps), np.arange(early, total, SELDOM * steps)])
        return (round(now / step) + np.append(clocks, total)) * step


def _breaks(figure: KeyFigure | None) -> bool:
    """Whether a key figure exists (is not None) and does not keep its limit."""
    return figure is not None and figure.kept is False


class _Run:
    """Future during its run: key figures, tensions over time, and the times from which on limits are not kept."""

    def __init__(self, scenario: Scenario, rest: Snapshot, name: str, assumed: str) -> None:
        self.name, self.assumed, self.fault = name, assumed, ""
        self.figures = KeyFigures(scenario, rest)
        self._kept: list[Memory] = []  # extremes at some moments
        self._times: list[float] = []
        self._highest: list[FloatArray] = []
        self._lowest: list[FloatArray] = []
        self._last: Snapshot | None = None
        self._rows: tuple[IntArray, IntArray] | None = None  # of both in a frame

    def take(self, snapshot: Snapshot) -> None:
        """Add the next snapshot of the future to its key figures and extreme tensions."""
        self.figures.update(snapshot)
        if self._rows is None:
            places = snapshot.layout.places
            self._rows = places.highest_tension[:, 0].astype(np.int64), places.lowest_tension[:, 0].astype(np.int64)
        self._times.append(snapshot.time)
        self._highest.append(snapshot.numbers[self._rows[0]])
        self._lowest.append(snapshot.numbers[self._rows[1]])
        self._last = snapshot

    def note(self) -> None:
        """Store the present extremes, in which the times of limits that are not kept are found after the run."""
        self._kept.append(self.figures.extremes())

    def _broken(self, found: Sequence[KeyFigure]) -> dict[FigureId, float]:
        """Times (s) at which key figures in `found` first did not keep their limits, for those that do not.

        An extreme beyond its limit stays so, and the first of the kept moments with one is found by halving.
        """
        moments: dict[int, dict[FigureId, KeyFigure]] = {}

        def at(moment: int) -> dict[FigureId, KeyFigure]:
            if moment not in moments:
                moments[moment] = {one.id: one for one in self.figures.figures_with(self._kept[moment])}
            return moments[moment]

        def first_breaking(figure: FigureId) -> int:
            return bisect_left(moments_kept, True, key=lambda moment: _breaks(at(moment).get(figure)))

        moments_kept, times = range(len(self._kept)), {}
        for one in found:
            if one.kept is False:
                first = first_breaking(one.id)
                times[one.id] = at(first)[one.id].time if first < len(moments_kept) else one.time
        return times

    def future(self, *, run: bool) -> Future:
        """Result of the future: key figures, times of limits not kept, tensions; no figures where it was not run."""
        found = [one for one in self.figures.figures() if one.id.quantity != LEFT_OUT] if run else []
        passed = self._broken(found)
        shown = tuple(one for one in found if one.id.quantity in SHOWN or one.id in passed)
        times, highest, lowest = (np.array(one) for one in (self._times, self._highest, self._lowest))
        last = self._last if run else None
        return Future(self.name, self.assumed, shown, passed, times, highest, lowest, last, self.fault)
