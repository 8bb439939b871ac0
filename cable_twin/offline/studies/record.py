"""Files of a study: finished cases as lines with hashes and host, manifest, and tables of all results."""

from __future__ import annotations

import csv
import fcntl
import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.offline.studies.case import Case, Finished, Names, digest

CASES, MANIFEST, TABLE, PARQUET = "cases.jsonl", "manifest.json", "results.csv", "results.parquet"
ENDS = "from", "to"  # of the range of a key in the manifest; a list of values is one there, too
ROWS = 10_000  # that are written at once
RESULT = ("fault", "refused", "exceeded", "figures")  # what is the same on any host


class StudyInUseError(ValueError):
    """Error of a directory of a study that another process is writing; the message is one line."""


class Kept:
    """File of the finished cases of a study, a line of JSON each, found by the hash of their inputs.

    A line that was cut off by a kill, or that is damaged, counts as missing.

    Args:
        directory: existing directory of the study.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.names: dict[str, tuple[str, str]] = {}
        self._places: dict[str, tuple[int, int]] = {}  # of lines in the file, by hash of the inputs
        self._file: IO[bytes] = (directory / CASES).open("a+b")

    def read(self) -> None:
        """Read the file of finished cases: index all whole lines, and cut off an incomplete last one."""
        self._file.seek(0)
        end = 0
        for line in self._file:
            if not line.endswith(b"\n"):
                break
            if (one := _parsed(line)) is not None:
                self._places[one.inputs] = end, len(line)
            elif (names := _names(line)) is not None:
                self.names |= names
            end += len(line)
        self._file.truncate(end)

    def __contains__(self, inputs: str) -> bool:
        """Whether a case with a hash of inputs is finished."""
        return inputs in self._places

    def add(self, one: Finished, names: Names) -> None:
        """Append a finished case to the file, safe from a kill of this process."""
        if new := {key: name for key, name in names.items() if key not in self.names}:
            self.names |= new
            self._write({"names": new})
        result = digest({key: getattr(one, key) for key in RESULT})
        self._places[one.inputs] = self._write({**one._asdict(), "result": result})
        self._file.flush()

    def results(self, cases: Sequence[Case]) -> Iterator[Finished | None]:
        """Results of cases of the study in their order; None for a case that is not finished."""
        for case in cases:
            if (place := self._places.get(case.inputs)) is None:
                yield None
                continue
            self._file.seek(place[0])
            found = _parsed(self._file.read(place[1]))
            yield None if found is None else found._replace(case=case.id)

    def close(self) -> None:
        """Flush the file of finished cases to disk and close it."""
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()

    def lock(self) -> bool:
        """Lock the file of finished cases for this process; returns whether no other process has it."""
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    def _write(self, content: Mapping[str, Any]) -> tuple[int, int]:
        line = json.dumps(content, allow_nan=True).encode() + b"\n"
        place = self._file.seek(0, os.SEEK_END)
        self._file.write(line)
        return place, len(line)


@contextmanager
def kept_in(directory: Path) -> Iterator[Kept]:
    """Context with the finished cases in the directory of a study, made where missing and locked for this process.

    Raises:
        StudyInUseError: another process uses the directory.
        OSError: the directory cannot be written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    kept = Kept(directory)
    try:
        if not kept.lock():
            raise StudyInUseError(f"{directory / CASES}: in use by another study; allowed: another directory")
        kept.read()
        yield kept
    finally:
        kept.close()


def _parsed(line: bytes) -> Finished | None:
    """Parse a line of a study's file into a finished case; None for another kind of line or a damaged one."""
    try:
        content = json.loads(line)
        result = content.pop("result")
        if digest({key: content[key] for key in RESULT}) != result:
            return None
        content["figures"] = {key: tuple(one) for key, one in content["figures"].items()}
        return Finished(**content)
    except (ValueError, KeyError, TypeError, AttributeError):
        return None


def _names(line: bytes) -> dict[str, tuple[str, str]] | None:
    try:
        return {key: (name, unit) for key, (name, unit) in json.loads(line)["names"].items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        return None


class Results:
    """Results of all cases of a study as columns.

    Args:
        cases: all cases.
        kept: finished cases.

    Attributes:
        cases: all cases.
        faults: fault of each case; "not calculated" where it is not finished.
        not_kept: number of limits that each case does not keep.
        figures: (cases,) values of each key figure by id; NaN where a case lacks it.
        names: name and unit of each key figure by id.
    """

    def __init__(self, cases: Sequence[Case], kept: Kept) -> None:
        self.cases, self.names = cases, kept.names
        self.faults, self.refused, self.not_kept = [], [], []
        found: dict[str, FloatArray] = {}
        for row, one in enumerate(kept.results(cases)):
            self.faults.append("not calculated" if one is None else one.fault)
            self.refused.append(0 if one is None else len(one.refused))
            self.not_kept.append(0 if one is None else len(one.exceeded))
            for key, (value, _, _) in ({} if one is None else one.figures).items():
                if key not in found:
                    found[key] = np.full(len(cases), np.nan)
                found[key][row] = value
        self.figures: Mapping[str, FloatArray] = {key: found[key] for key in sorted(found)}

    def columns(self) -> dict[str, Any]:
        """Columns of the table of results by name: values of varied keys, errors, key figures."""
        keys = list(self.cases[0].values) if self.cases else []
        return {
            "case": [one.id for one in self.cases],
            **{key: [one.values[key] for one in self.cases] for key in keys},
            "fault": self.faults,
            "refused": self.refused,
            "limits_not_kept": self.not_kept,
            **self.figures,
        }


def write_tables(directory: Path, results: Results) -> list[Path]:
    """Write the results of a study as CSV, a row for each case, and as Parquet if pyarrow is there; returns the files.

    Raises:
        OSError: a file cannot be written.
    """
    columns = results.columns()
    written = [directory / TABLE]
    with whole_file(written[0]) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for first in range(0, len(results.cases), ROWS):
            part = [values[first : first + ROWS] for values in columns.values()]
            part = [values.tolist() if isinstance(values, np.ndarray) else values for values in part]
            for row in zip(*part, strict=True):
                writer.writerow(["" if isinstance(one, float) and math.isnan(one) else one for one in row])
    if find_spec("pyarrow") is not None:
        import pyarrow  # noqa: PLC0415 - not always installed
        from pyarrow import parquet  # noqa: PLC0415 - the same

        written.append(directory / PARQUET)
        units = {key: {"unit": results.names[key][1], "name": results.names[key][0]} for key in results.figures}
        arrays = [pyarrow.array(values) for values in columns.values()]
        fields = [pyarrow.field(name, array.type, metadata=units.get(name))
                  for name, array in zip(columns, arrays, strict=True)]  # fmt: skip
        parquet.write_table(pyarrow.table(arrays, schema=pyarrow.schema(fields)), written[-1])
    return written


def write_manifest(directory: Path, study: Mapping[str, Any], results: Results, files: Sequence[Path]) -> None:
    """Write the manifest of a study: inputs, program, counts, names of key figures, and hashes of all files.

    Raises:
        OSError: the file cannot be written.
    """
    missing = sum(one == "not calculated" for one in results.faults)
    content = {
        **study,
        "cases": len(results.cases),
        "finished": len(results.cases) - missing,
        "with_fault": sum(map(bool, results.faults)) - missing,
        "figures": {key: dict(zip(("name", "unit"), results.names[key], strict=True)) for key in results.figures},
        "files": {file.name: hash_of_file(file) for file in (directory / CASES, *files)},
    }
    with whole_file(directory / MANIFEST) as file:
        json.dump(content, file, indent=1)
        file.write("\n")


def hash_of_file(file: Path) -> str:
    """SHA-256 of the content of a file."""
    found = hashlib.sha256()
    with file.open("rb") as content:
        while part := content.read(2**20):
            found.update(part)
    return found.hexdigest()


@contextmanager
def whole_file(path: Path) -> Iterator[IO[str]]:
    """Context with a text file to write, which replaces the file at a path atomically at the end."""
    part = path.with_suffix(".partial")
    with part.open("w", encoding="utf-8", newline="") as file:
        yield file
    part.replace(path)
