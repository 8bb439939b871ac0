"""Scenarios named or sent by other nodes: only from allowed directories, read and checked in a separate process.

A file that never ends, a pipe or a slow scenario delays nothing, and every failure is a refusal. The contents of files
elsewhere, and whether they exist, are not revealed.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path
from threading import Lock, Thread
from typing import Any

from cable_twin.basics.printable import printable, printable_lines
from cable_twin.runtime.separate_process import SeparateProcessError, answer, ask_process
from cable_twin.scenario import (
    Scenario,
    ScenarioError,
    config_directory,
    load_scenario,
    parse_scenario,
    scenario_names,
)

SECONDS = 20.0  # s for one scenario, on a busy machine
SUFFIXES = (".yaml", ".yml")


class NoScenarioError(ScenarioError):
    """Error of a scenario that does not exist, or whose path is not allowed."""


class ScenarioReader:
    """Reader of scenarios for one twin, in a separate process.

    Args:
        directories: allowed directories besides that of the package; messages quote the faults of files below them.
        started_with: name or path of the scenario at the start; files beside it are allowed too, but messages do not
            quote their faults.
    """

    def __init__(self, directories: Sequence[Path], started_with: str) -> None:
        self._quoted = [config_directory().resolve(), *(_resolved(one) for one in directories)]
        first = Path(started_with)
        self._unquoted = [_resolved(first.parent)] if first.suffix in SUFFIXES else []
        self._lock = Lock()

    def read(self, source: str, text: str = "") -> Future[Scenario]:
        """Read a scenario by name or path, or from a YAML text; returns a future, which may fail with ScenarioError."""
        future: Future[Scenario] = Future()
        if not self._lock.acquire(blocking=False):
            given = f"scenario: given {printable(source or 'text')} while another one is being read"
            future.set_exception(ScenarioError(f"{given}; allowed: one at a time"))
            return future
        Thread(target=self._run, args=(future, source, text), name="reading", daemon=True).start()
        return future

    def worlds(self) -> Future[list[tuple[str, str]]]:
        """Return a future of the names and descriptions of all scenarios shipped with the package."""
        future: Future[list[tuple[str, str]]] = Future()

        def run() -> None:
            names = scenario_names()
            try:
                future.set_result([*zip(names, ask_process("runtime.scenario_reading", names, SECONDS), strict=True)])
            except Exception as error:
                future.set_exception(ScenarioError(f"the scenarios are not read: {printable(error)}"))

        Thread(target=run, name="reading", daemon=True).start()
        return future

    def _run(self, future: Future[Scenario], source: str, text: str) -> None:
        try:
            scenario = self._read(source, text)
        except ScenarioError as error:
            future.set_exception(error)
        except Exception as error:  # a fault of the program: reported to the caller, and the twin goes on
            future.set_exception(ScenarioError(f"{printable(source)}: fault of the program: {type(error).__name__}"))
        else:
            future.set_result(scenario)
        finally:
            self._lock.release()

    def _read(self, source: str, text: str) -> Scenario:
        named, quoted = (source, True) if text else self._place(source)
        try:
            found = ask_process("runtime.scenario_reading", {"source": named, "text": text}, SECONDS)
        except SeparateProcessError as error:
            raise ScenarioError(f"{printable(source or 'text')}: not a scenario: {error}") from None
        if "faults" in found:
            if not quoted:
                shown = printable(named, 400)
                raise ScenarioError(f"{shown}: not a scenario; `simulate {shown}` says why")
            raise ScenarioError(*printable_lines("\n".join(found["faults"])).split("\n"))
        return load_scenario(found["scenario"])

    def _place(self, source: str) -> tuple[str, bool]:
        """Check the name or path of a scenario; returns what to read, and whether messages may quote its contents.

        Raises:
            NoScenarioError: there is no such scenario, or its path is not allowed.
        """
        names = scenario_names()
        if source in names:
            return source, True
        path = Path(source)
        if path.name == source and path.suffix not in SUFFIXES:
            raise NoScenarioError(
                f"scenario: given '{printable(source)}', which is neither a scenario nor a file; "
                f"allowed: {', '.join(names) or '(none installed)'}, or the path of a YAML file"
            )
        if path.parent == config_directory() and path.suffix in SUFFIXES and path.stem in names:
            return path.stem, True  # also a link, as in a development install
        file = _resolved(path)
        for directories, quoted in ((self._quoted, True), (self._unquoted, False)):
            if file.suffix in SUFFIXES and any(file.is_relative_to(one) for one in directories):
                if not _is_regular(file):
                    raise NoScenarioError(f"{printable(source, 400)}: no such file; allowed: a YAML file")
                return str(file), quoted
        places = ", ".join(map(str, dict.fromkeys([*self._quoted, *self._unquoted])))
        raise NoScenarioError(
            f"{printable(source, 400)}: not a scenario; allowed: the name of one, or a .yaml file below {places} "
            "or the directories in the parameter scenario_directories"
        )


def _resolved(path: Path) -> Path:
    """Absolute path without links; for an invalid path the root directory, which holds no scenario."""
    try:
        return path.expanduser().resolve()
    except (OSError, RuntimeError, ValueError):
        return Path("/")


def _is_regular(file: Path) -> bool:
    """Whether a path is a regular file, neither a pipe nor a device nor a directory."""
    try:
        return stat.S_ISREG(os.stat(file, follow_symlinks=False).st_mode)
    except (OSError, ValueError):
        return False


def _work(request: Any) -> Any:
    """Read the requested scenario; returns its resolved data, or error messages; for a list of names, descriptions."""
    if isinstance(request, list):
        return [load_scenario(name).description for name in request]
    try:
        text = request["text"]
        scenario = parse_scenario(text) if text else load_scenario(request["source"])
    except ScenarioError as error:
        return {"faults": list(error.faults)}
    except Exception as error:  # whatever it is, the file is refused
        return {"faults": [f"{request['source'] or 'text'}: not a scenario: fault of the program: {error!r}"]}
    return {"scenario": scenario.resolved()}


if __name__ == "__main__":
    answer(_work)
