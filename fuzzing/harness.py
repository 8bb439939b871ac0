"""Harness of the fuzzers: runs cases in a child process with limits, counts outcomes, and keeps findings."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.strategies import SearchStrategy

from fuzzing import Case
from fuzzing.child import MEMORY, READY, ROOT, TRACEBACK, place_of

SEEDS = Path(__file__).parent / "seeds"
HANG, SIGNAL, START = "hang", "signal", "start"
FINDINGS = (TRACEBACK, HANG, MEMORY, SIGNAL, START)  # kinds that are one; START: the child did not come up
COMPILING = "/numba/", "/llvmlite/", "first_compilation.py"  # files in a stack: that time does not count
LONGEST_COMPILATION = 20  # times the limit of a case
BATCH = 200  # cases of one seed of hypothesis
BEFORE = 5  # cases before one that ended the child, which are kept with it


@dataclass(frozen=True)
class Limits:
    """Time and memory that a case may take."""

    seconds: float = 30.0
    memory: int = 4 * 2**30  # bytes


@dataclass(frozen=True)
class Finding:
    """Case in which the program fails."""

    kind: str  # one of FINDINGS
    place: str  # where, as `place_of` says it
    text: str  # traceback or stacks, and the last of what was printed
    files: tuple[Path, ...]  # the case, after those before it where the child has ended


@dataclass
class Counts:
    """Outcomes of the cases of a fuzzer."""

    kinds: Counter[str] = field(default_factory=Counter)
    findings: list[Finding] = field(default_factory=list)  # one a place
    peak: int = 0  # bytes, of the child
    slowest: float = 0.0  # s
    seconds: float = 0.0  # of all

    @property
    def runs(self) -> int:
        """Number of cases so far."""
        return self.kinds.total()


class Child:
    """Child process that runs cases, restarted after its death."""

    def __init__(self, module: str, limits: Limits, directory: Path) -> None:
        self._module, self._limits, self._directory = module, limits, directory
        self._process: subprocess.Popen[bytes] | None = None
        self._rest = b""  # of an answer

    def run(self, file: Path) -> tuple[str, str]:
        """Run a case; returns kind and text of its outcome."""
        if self._process is None and (failed := self.start()):
            return START, failed
        assert self._process is not None
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):
            self._process.stdin.write((json.dumps(str(file)) + "\n").encode())
            self._process.stdin.flush()
        return self._answer(self._limits.seconds)

    @property
    def peak(self) -> int:
        """Highest memory (bytes) of the process and its children; 0 after its end."""
        if self._process is None:
            return 0
        pid, found = self._process.pid, [0]
        with suppress(OSError):
            for one in (str(pid), *Path(f"/proc/{pid}/task/{pid}/children").read_text().split()):
                lines = Path(f"/proc/{one}/status").read_text().splitlines()
                found += [int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:")]
        return max(found)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def start(self) -> str:
        """Start the process and wait until ready; returns the reason of a failure, empty otherwise."""
        command = [sys.executable, "-m", "fuzzing.child", self._module, str(self._limits.memory), str(self._directory)]
        paths = [str(ROOT), *filter(None, sys.path)]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
        self._process = subprocess.Popen(
            command, cwd=self._directory, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._rest = b""
        kind, text = self._answer(max(60.0, self._limits.seconds))
        return "" if kind == READY else f"{kind}: {text}"

    def _answer(self, seconds: float) -> tuple[str, str]:
        """Wait for the outcome of a case; a case beyond its time is ended, but for the time of compilation."""
        process, waited = self._process, 0.0
        assert process is not None
        assert process.stdout is not None
        for _ in range(LONGEST_COMPILATION):
            since, delayed = time.monotonic(), self._delay()
            while (left := seconds - (time.monotonic() - since) + (self._delay() - delayed)) > 0.0:
                if not select.select([process.stdout], [], [], min(left, 1.0))[0]:
                    continue
                read = os.read(process.stdout.fileno(), 1 << 16)
                if not read:
                    return self._died()
                self._rest += read
                if self._rest.endswith(b"\n"):
                    kind, text = json.loads(self._rest)
                    self._rest = b""
                    return kind, f"{text}{self._printed()}" if text else ""
            waited += seconds
            if not any(word in (stacks := self._stacks()) for word in COMPILING):
                break
        printed = self._printed()
        self.close()
        return HANG, f"no answer in {waited:g} s\n{stacks}{printed}"

    def _delay(self) -> float:
        """Time (s) for which the main thread has waited for a core used by others."""
        with suppress(OSError, IndexError):
            return int(Path(f"/proc/{self._process.pid}/schedstat").read_text().split()[1]) * 1e-9
        return 0.0

    def _stacks(self) -> str:
        """Stacks of all threads of the process."""
        assert self._process is not None
        file = self._directory / "stacks"
        size = file.stat().st_size if file.exists() else 0
        with suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGUSR1)
        deadline = time.monotonic() + 2.0
        while time.monotonic() < deadline and (not file.exists() or file.stat().st_size == size):
            time.sleep(0.05)
        time.sleep(0.1)
        return file.read_bytes()[size:].decode(errors="replace") if file.exists() else ""

    def _died(self) -> tuple[str, str]:
        assert self._process is not None
        code = self._process.wait()
        text = (self._directory / "stacks").read_text(errors="replace") + self._printed()
        self._process = None
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return SIGNAL, f"{name}\n{text}"

    def _printed(self) -> str:
        """Last part of the output of the process."""
        with suppress(OSError):
            printed = (self._directory / "output").read_bytes()[-2000:].decode(errors="replace").strip()
            return f"\nprinted:\n{printed}" if printed else ""
        return ""


def fuzz(
    module: str,
    *,
    seconds: float,
    number: int,
    keep: Path,
    limits: Limits | None = None,
    on_case: Callable[[Counts], object] = lambda _: None,
    seeds: Path | None = None,
    most: int = sys.maxsize,
) -> Counts:
    """Run a fuzzer.

    Args:
        module: name of its module.
        seconds: for how long cases are drawn, once the process has started and the kept seeds have run.
        number: of the seed, from which the cases come.
        keep: directory for what it finds, made when there is something.
        limits: of each case.
        on_case: gets the counts after each case.
        seeds: directory of kept cases, which run first.
        most: cases, after which it ends before the time.
    """
    counts, started = Counts(), time.monotonic()
    with tempfile.TemporaryDirectory(prefix="cable_twin_fuzzing_") as name:
        directory = Path(name)
        child = Child(module, limits or Limits(), directory)
        recent: deque[Path] = deque(maxlen=BEFORE + 1)

        def take(case: Case) -> None:
            file = directory / f"case_{counts.runs:07}{case.suffix}"
            file.write_bytes(case.content)
            if len(recent) == recent.maxlen:
                recent[0].unlink()
            recent.append(file)
            begun = time.monotonic()
            kind, text = child.run(file)
            counts.slowest = max(counts.slowest, time.monotonic() - begun)
            counts.kinds[kind] += 1
            counts.peak = max(counts.peak, child.peak)
            if kind in FINDINGS:
                _keep(counts, kind, text, list(recent), keep / module.rpartition(".")[2])
            counts.seconds = time.monotonic() - started
            on_case(counts)

        try:
            if failed := child.start():
                counts.kinds[START] += 1
                counts.findings.append(Finding(START, module, failed, ()))
                return counts
            for file in sorted(seeds.iterdir()) if seeds is not None and seeds.is_dir() else ():
                take(Case(file.read_bytes(), file.suffix))
            fuzzer = import_module(module)
            for case in fuzzer.first() if hasattr(fuzzer, "first") else ():
                take(case)
            strategy, drawn = fuzzer.cases(), time.monotonic()
            _draw(strategy, number, lambda: time.monotonic() - drawn < seconds and counts.runs < most, take)
        finally:
            child.close()
    counts.seconds = time.monotonic() - started
    return counts


def replay(module: str, file: Path, limits: Limits | None = None) -> tuple[str, str]:
    """Run one case; returns kind and text of its outcome."""
    with tempfile.TemporaryDirectory(prefix="cable_twin_fuzzing_") as directory:
        child = Child(module, limits or Limits(), Path(directory))
        try:
            return child.run(file.absolute())
        finally:
            child.close()


def _draw(
    strategy: SearchStrategy[Case], number: int, goes_on: Callable[[], bool], take: Callable[[Case], None]
) -> None:
    """Run cases drawn by hypothesis, batch after batch, until the time is over."""
    batch = 0
    while goes_on():

        @seed(1000 * number + batch)
        @settings(
            max_examples=BATCH,
            database=None,
            deadline=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(strategy)
        def draw(case: Case) -> None:
            if goes_on():
                take(case)

        draw()
        batch += 1


def _keep(counts: Counts, kind: str, text: str, files: list[Path], directory: Path) -> None:
    """Keep the first finding of each kind and place, with the earlier cases where it ended the process."""
    place = place_of(text) if kind in (TRACEBACK, MEMORY) else _stack_place(text)
    if any((one.kind, one.place) == (kind, place) for one in counts.findings):
        return
    directory.mkdir(parents=True, exist_ok=True)
    name = f"{kind}_{len(counts.findings) + 1}"
    kept = []
    for age, file in enumerate(reversed(files if kind == SIGNAL else files[-1:])):
        target = directory / f"{name}{f'_before_{age}' if age else ''}{file.suffix}"
        target.write_bytes(file.read_bytes())
        kept.append(target)
    (directory / f"{name}.log").write_text(text, encoding="utf-8")
    counts.findings.append(Finding(kind, place, text, tuple(kept)))


def _stack_place(text: str) -> str:
    """Innermost lines of this project in the stack of the interrupted thread."""
    first, _, stack = text.partition("\n")
    _, current, below = stack.partition("Current thread")
    lines = (below.partition("\n\n")[0] if current else stack).splitlines()
    own = [line.strip() for line in lines if str(ROOT / "cable_twin") in line]
    return " < ".join([f"{first}: {own[0]}", *own[1:3]]).replace(f"{ROOT}/", "") if own else first
