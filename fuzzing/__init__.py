"""Fuzzers: hostile files and messages, generated and mutated, as input of the real program.

A fuzzer is a module beside this file with these functions (`first` is optional), and a row in `FUZZERS`:

    cases()     a strategy of hypothesis that gives a `Case`: the content of one file
    prepare()   in the child process, once: what all cases need, such as compiled kernels
    first()     some cases that run before all others, where files for that would be large: one that is sound, and one
                that is refused
    run(file)   in the child process, for each case: feeds it to the program and returns DONE or REFUSED; whatever it
                raises is a finding, and so are a signal, a hang and memory beyond the limit

`python -m fuzzing` runs them, and keeps what it finds as files. Those that are worth running each time are in
`seeds/NAME/`.
"""

from __future__ import annotations

from dataclasses import dataclass

DONE, REFUSED = "done", "refused"  # what `run` of a fuzzer returns

FUZZERS = {  # module: what it feeds to which part of the program
    "scenarios": "scenario files, mutated, to `simulate` for some steps",
    "scripts": "scripts of commands, YAML and CSV, to a run of two scenarios",
    "bags": "logs with changed bytes, records, messages, metadata and states, to `review`, `replay` and `--from-bag`",
    "messages": "messages on the topics that bring commands, sound, strange and damaged, to a running twin",
    "parameters": "parameters, scenarios that are loaded by them, and calls of all services, to a running twin",
    "snapshots": "files of a full state, with changed bytes, numbers, shapes and headers, to a simulation that goes on",
}


@dataclass(frozen=True)
class Case:
    """One input of a fuzzer, stored as a file."""

    content: bytes
    suffix: str  # of the file's name
