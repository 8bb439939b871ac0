"""The process in which cases run: `python -m fuzzing.child MODULE BYTES DIRECTORY`, a file a line on its input.

It answers each with a line, a JSON of kind and text. What the program prints goes to DIRECTORY/output, and the stacks
of all threads to DIRECTORY/stacks at SIGUSR1 and where it crashes.
"""

from __future__ import annotations

import faulthandler
import json
import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from fuzzing import DONE, REFUSED

ROOT = Path(__file__).parents[1]
MEMORY, TRACEBACK, READY = "memory", "traceback", "ready"  # kinds of answers, beside DONE and REFUSED


def main() -> None:
    """Run cases until the end of the input."""
    module, limit, directory = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    output = os.open(directory / "output", os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
    os.dup2(output, 1)
    os.dup2(output, 2)
    with (directory / "stacks").open("w") as stacks:
        faulthandler.enable(stacks)
        faulthandler.register(signal.SIGUSR1, stacks)
        fuzzer = import_module(module)
        fuzzer.prepare()
        # of addresses, so that what asks for more gets an error, and the machine stays as it was
        resource.setrlimit(resource.RLIMIT_AS, (_addresses() + limit, resource.RLIM_INFINITY))
        answers.write(json.dumps([READY, ""]) + "\n")
        for line in sys.stdin:
            os.ftruncate(output, 0)
            answers.write(json.dumps(_answer(fuzzer.run, Path(json.loads(line)))) + "\n")


def _addresses() -> int:
    """Address space (bytes) that this process uses already."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def _answer(run: Callable[[Path], str], file: Path) -> list[str]:
    """Kind and text of the outcome of one case."""
    try:
        kind = run(file)
    except MemoryError:
        return [MEMORY, traceback.format_exc(limit=-12)]
    except SystemExit as error:  # of argparse, or of a command that ends itself
        return [REFUSED if error.code else DONE, ""]
    except BaseException:  # all that gets through is a finding
        return [TRACEBACK, traceback.format_exc(limit=-40)]
    if kind not in (DONE, REFUSED):
        return [TRACEBACK, f"run returned {kind!r}; allowed: DONE, REFUSED"]
    return [kind, ""]


def place_of(text: str) -> str:
    """Innermost line of this project in a traceback, and its error, which identify a finding."""
    lines = text.partition("\nprinted:")[0].strip().splitlines()
    places = [line.strip() for line in lines if line.lstrip().startswith('File "') and str(ROOT) in line]
    last = places[-1].replace(str(ROOT) + "/", "") if places else ""
    error = lines[-1].partition(":")[0] if lines else ""
    return f"{error} at {last}" if last else error


if __name__ == "__main__":
    main()
