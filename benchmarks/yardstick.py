"""Processes of this checkout and of the reference commit, which simulate pieces of one ropeway in turn.

The unit is the solver of one commit, which stays the same when later work makes the solver faster; its sources come out
of the history of this checkout.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from benchmarks.measure import ROOT, BenchmarkError, environment_of_user
from cable_twin.mechanics.language.kernel_cache import MECHANICS, cache_directory

YARDSTICK = "757d35a"  # commit whose solver is the unit


@dataclass(frozen=True, slots=True)
class Case:
    """Ropeway under way, for both contestants."""

    scenario: str
    drive: str
    speed: float  # m/s
    changes: tuple[str, ...] = ()

    @property
    def arguments(self) -> tuple[str, ...]:
        """Arguments of `frame_process`."""
        return (self.scenario, self.drive, str(self.speed), *self.changes)


CASES = {
    "aerial_tramway": Case("aerial_tramway", "cabin", 7.0),
    "chairlift": Case("chairlift", "haul_rope", 2.5),
    "gondola": Case("gondola", "haul_rope", 6.0),
}


class Contestant:
    """Process that simulates pieces of a case."""

    def __init__(self, kind: str, case: Case, sources: Path, python: str = sys.executable) -> None:
        environment = {**environment_of_user(), "PYTHONPATH": str(sources)}
        command = [python, str(ROOT / "benchmarks" / "frame_process.py"), kind, *case.arguments]
        self._process = subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=sources
        )

    def wait(self) -> None:
        """Wait until the process has started."""
        self._answer()

    def run(self, duration: float) -> float:
        """Processor time (s) of a piece with a duration (s)."""
        assert self._process.stdin is not None
        print(duration, file=self._process.stdin, flush=True)
        return float(self._answer())

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        if not (line := self._process.stdout.readline()):
            raise BenchmarkError("a process of the part frame has ended; its error stands above")
        return line


@contextmanager
def contestants(kinds: Sequence[str], case: Case, yardstick: Path) -> Iterator[dict[str, Contestant]]:
    """Started processes of one case."""
    with ExitStack() as stack:
        running = {}
        for kind in kinds:
            own = ("solver", yardstick) if kind == "yardstick" else (kind, ROOT)
            running[kind] = Contestant(own[0], case, own[1])
            stack.callback(running[kind].close)
            running[kind].wait()  # one after the other: they compile
        yield running


@contextmanager
def yardstick_sources() -> Iterator[tuple[Path, str]]:
    """Sources of the reference commit, or of this checkout without history, and a note on them."""
    archive = subprocess.run(
        ["git", "-C", str(ROOT), "archive", YARDSTICK, "cable_twin", "config", "resource"],
        capture_output=True,
        check=False,
    )
    if archive.returncode != 0:
        yield ROOT, f"**The unit is the solver of this checkout**, as the commit {YARDSTICK} is not in its history."
        return
    kept = cache_directory(MECHANICS)
    with tempfile.TemporaryDirectory(prefix="yardstick_", dir=None if kept is None else kept.parent) as directory:
        sources = Path(directory) / "sources"
        with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as content:
            content.extractall(sources, filter="data") if sys.version_info >= (3, 12) else content.extractall(sources)
        if kept is not None:  # its kernels are compiled once: numba knows them by the place of their sources
            place = kept.parent / f"yardstick-{YARDSTICK}"
            with suppress(OSError):  # they are there
                sources.rename(place)
            sources = place
        yield sources, f"The unit is the solver of commit {YARDSTICK}, run beside."
