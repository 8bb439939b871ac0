"""Result of a replay."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any

from cable_twin.frame.records import AppliedCommand
from cable_twin.messages.command_messages import applied_command_message


@dataclass(slots=True)
class Difference:
    """Difference between log and replay in one field."""

    time: float  # s
    topic: str
    place: str
    logged: Any
    replayed: Any

    def __str__(self) -> str:
        return f"at {self.time:.6f} s on {self.topic}, {self.place}: logged {self.logged!r}, replayed {self.replayed!r}"


@dataclass(slots=True)
class CommandStream:
    """Counted commands of a log."""

    kinds: Counter[str] = field(default_factory=Counter)
    sources: Counter[str] = field(default_factory=Counter)
    digest: Any = field(default_factory=sha256)

    def add(self, applied: AppliedCommand) -> None:
        """Count one command."""
        self.kinds[applied.command.kind] += 1
        self.sources[applied.source] += 1
        self.digest.update(applied_command_message(applied, 0))

    def __str__(self) -> str:
        sources = f" from {_counted(self.sources)}" if self.sources else ""
        return f"{_counted(self.kinds)}{sources}, sha256 {self.digest.hexdigest()[:12]}"


@dataclass(slots=True)
class Comparison:
    """Result of the comparison of a replay with its log."""

    samples: Counter[str] = field(default_factory=Counter)
    differing: Counter[str] = field(default_factory=Counter)
    first: Difference | None = None
    largest: float = 0.0  # greatest difference of two numbers found, relative where they are above 1
    commands: CommandStream = field(default_factory=CommandStream)
    restarts: list[str] = field(default_factory=list)  # files that were simulated from their own state, a line each
    end: float = 0.0  # s, of what was compared last

    @property
    def agrees(self) -> bool:
        """Whether every sample agreed, with at least one sample."""
        return not self.differing and bool(self.samples)


def _counted(counts: Counter[Any]) -> str:
    """Text of words with their counts."""
    return ", ".join(f"{count} {word}" for word, count in counts.items()) or "none"
