"""One-pass reader of the bag of a run for `review`: key figures, signals, responses, tables and view."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, Protocol

from cable_twin.basics.units import counted
from cable_twin.frame.records import AppliedCommand, RefusedCommand
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.key_figures.rules import Profile, RuleError, RuleVerdict, judge, profiles_of
from cable_twin.messages.figure_messages import figures_of_statuses
from cable_twin.offline.export import RunTable
from cable_twin.offline.responses import Responses
from cable_twin.offline.thinned_series import SAME, Signals, signal_values
from cable_twin.recording.log_file import LogError
from cable_twin.recording.log_reader import Item, Log, RecordedFigures, read_snapshots
from cable_twin.scenario import ScenarioError, load_scenario

USUAL = "cable_twin_logs"  # where runs are that nobody has named
FIGURES_AGE = 1.5  # s before the end at which the last key figures may have been recorded without a word


class _View(Protocol):
    def log(self, snapshot: Snapshot) -> None: ...

    def log_command(self, applied: AppliedCommand) -> None: ...


class Reading:
    """One-pass reader of the bag of a run for `review`: key figures, signals, responses, tables and view.

    Args:
        log: The bag.
        on_position: Called with the bytes read so far.
        profiles: Rule profiles in place of those of the scenario.
        facts: Keys of `limits.installation` in place of those of the scenario.
        part: Simulated times (s), first and last, outside of which frames and commands are left out, as are key figures
            recorded by the run itself.
        figures: Key figures in place of those of the log.

    Raises:
        LogError: The log holds no frame, or its scenario cannot be understood.
    """

    def __init__(
        self,
        log: Log,
        on_position: Callable[[int], None] | None = None,
        profiles: Sequence[str] | None = None,
        facts: Mapping[str, Any] | None = None,
        part: tuple[float, float] | None = None,
        figures: Sequence[KeyFigure] | None = None,
    ) -> None:
        self.log = log
        stated = {f"limits.installation.{key}": value for key, value in (facts or {}).items()}
        self.rule_faults: tuple[str, ...] = ()  # of profiles of the scenario, such as files that are not here
        try:
            self.scenario = load_scenario(log.scenario, stated)
            self.profiles = self._profiles(profiles)
        except ScenarioError as error:
            raise LogError("\n".join(f"{log.path}: {fault}" for fault in error.faults)) from error
        self._gathered = KeyFigures(self.scenario)
        self._recorded: list[KeyFigure] | None = None if figures is None else list(figures)  # the last ones
        self._figures_time = 0.0 if figures is None else math.inf  # s, of those
        self.signals, self.responses = Signals(), Responses()
        self.view: _View | None = None
        self.table: RunTable | None = None
        self.frames, self.commands, self.end = 0, 0, 0.0
        self.refused: RefusedCommand | None = None  # the last one
        self._items = read_snapshots(log, on_position=on_position)
        if part is not None:  # without recorded key figures, as these are of the whole run
            first, last = part
            of_part = (item for item in self._items if not isinstance(item, RecordedFigures))
            self._items = (item for item in of_part if first - SAME <= item.time <= last + SAME)
        self._early: list[AppliedCommand | RefusedCommand | RecordedFigures] = []
        self.first = self._find_first()

    @property
    def name(self) -> str:
        """Name of the run: name of its directory, or of a single file."""
        return self.log.source.name

    @property
    def title(self) -> str:
        """Title of the run: name of the directory chosen by `--output`, empty for the default directory."""
        parent = self.log.source.parent.name
        return "" if parent == USUAL else parent

    def _find_first(self) -> Snapshot:
        for item in self._items:
            if isinstance(item, Snapshot):
                return item
            self._early.append(item)
        raise LogError(f"{self.log.path}: it contains no frame of the twin")

    def values(self) -> Iterator[tuple[float, Mapping[str, float]]]:
        """Read the bag to its end; yields time (s) and signals of each frame after processing it."""
        for item in chain(self._early, [self.first], self._items):
            yield from self._take(item)

    @property
    def figures(self) -> list[KeyFigure]:
        """Key figures that the run has recorded over all of its frames; if none, those of the logged frames."""
        return self._gathered.figures() if self._recorded is None else self._recorded

    @property
    def loops(self) -> dict[str, float]:
        """Length (m) of the loop by the name of the signal of each carrier's place on it; empty without a loop."""
        if self.scenario.carriers is None:
            return {}
        riding = self.first.layout.carriers
        return {f"arc_length/{name}": self.scenario.loop_length for name in riding}

    def _profiles(self, names: Sequence[str] | None) -> list[Profile]:
        if names is not None:
            return profiles_of(self.scenario, tuple(names))
        try:
            return profiles_of(self.scenario)
        except RuleError as error:
            self.rule_faults = error.faults
            return []

    @property
    def verdicts(self) -> list[RuleVerdict]:
        """Verdicts of the rule profiles on the key figures of the run."""
        return judge(self.scenario, self.figures, self.profiles)

    def _take(self, item: Item) -> Iterator[tuple[float, Mapping[str, float]]]:
        if isinstance(item, AppliedCommand):
            self.commands += 1
            self._gathered.command(item)
            if self.view is not None:
                self.view.log_command(item)
            return
        if isinstance(item, RefusedCommand):
            self.refused = item
            return
        if isinstance(item, RecordedFigures):
            self._recorded, self._figures_time = self._understand(item), item.time
            return
        values = signal_values(item)
        self._gathered.update(item)
        self.signals.update(item, values)
        self.responses.take(item)
        if self.view is not None:
            self.view.log(item)
        if self.table is not None:
            self.table.take(item)
        self.frames += 1
        self.end = item.time
        yield item.time, values

    def _understand(self, recorded: RecordedFigures) -> list[KeyFigure]:
        try:
            return figures_of_statuses(recorded.statuses)
        except ValueError as error:
            raise LogError(f"{self.log.path}: key figures at {recorded.time:.6f} s are unreadable: {error}") from error

    def summary(self) -> str:
        """Summary of the run in one line: condition of the log, scenario, duration or part, frames, commands."""
        part = f"{self.first.time:.2f} to " if self.first.time > SAME else ""
        whole = self._recorded is None or self.end - self._figures_time < FIGURES_AGE
        return (
            f"{self.log.path}: {self.log.condition}; scenario {self.scenario.name}, {part}{self.end:.2f} s, "
            f"{counted(self.frames, 'frame')}, {counted(self.commands, 'command')}"
            + (f", {self.refused.count} refused, the last {self.refused}" if self.refused else "")
            + ("" if whole else f"; key figures as of {self._figures_time:.2f} s, their last record")
        )
