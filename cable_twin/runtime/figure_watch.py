"""Key figures of a running twin: gathered by the solver's thread, reported by another, without rclpy."""

from __future__ import annotations

import threading

from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.messages import Status
from cable_twin.messages.figure_messages import OK, WARNING, describe, figure_statuses


class FigureWatch:
    """Watch of the limits of key figures.

    Args:
        figures: What gathers them.
    """

    def __init__(self, figures: KeyFigures) -> None:
        self._figures = figures
        self._lock = threading.Lock()  # so that value, time and place of an extreme belong together
        self._passed: dict[str, KeyFigure] = {}  # by name, as it was when it was first seen
        self._told: dict[tuple[str, str], float] = {}  # s, of the last touch of two vehicles
        self._news: list[str] = []

    def update(self, snapshot: Snapshot) -> None:
        """Update the key figures with a frame."""
        with self._lock:
            self._figures.update(snapshot)

    def command(self, applied: AppliedCommand) -> None:
        """Update the key figures with an applied command."""
        with self._lock:
            self._figures.command(applied)

    def limit(self, name: str) -> float | None:
        """Limit of the key figure of a name, in its unit; None without such a figure or limit."""
        with self._lock:
            figures = self._figures.figures()
        return next((figure.limit for figure in figures if figure.name == name), None)

    def statuses(self) -> list[Status]:
        """Status of each key figure: a warning for an exceeded limit."""
        with self._lock:
            figures, touches = self._figures.figures(), self._figures.touches()
        for touch in touches:
            if self._told.get((touch.vehicle, touch.other)) != touch.time:
                self._told[touch.vehicle, touch.other] = touch.time
                self._news.append(str(touch))
        for figure in figures:
            if figure.kept is False and figure.name not in self._passed:
                self._passed[figure.name] = figure
                self._news.append(f"limit exceeded: {figure.name}: {describe(figure)}")
        return figure_statuses(figures)

    def take_news(self) -> list[str]:
        """New messages: a line for each figure with a first exceeded limit, and for vehicles that have met."""
        taken, self._news = self._news, []
        return taken

    def judged(self) -> tuple[int, str, dict[str, str]]:
        """Level, message and figures for the task `limits`: a warning that names exceeded limits."""
        values = {figure.name: describe(figure) for figure in self._passed.values()}
        return (WARNING, f"limits exceeded: {', '.join(values)}", values) if values else (OK, "all limits kept", {})
