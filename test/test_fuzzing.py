"""Fuzzers for some seconds each, and detection of every kind of failure."""

import faulty_fuzzer
import pytest

from fuzzing import DONE, REFUSED
from fuzzing.harness import FINDINGS, SEEDS, Limits, fuzz, replay

SECONDS = 1.5  # of each fuzzer, beside its kept seeds and the start of its process
HOLDING = ("bags", "scenarios", "scripts", "snapshots")  # fuzzers that find nothing
LIVE = ("messages", "parameters")  # the same, of a running twin


@pytest.mark.long
@pytest.mark.parametrize("name", LIVE)
def test_nothing_is_found_in_a_running_twin(name, tmp_path, domain, monkeypatch):
    pytest.importorskip("rclpy")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    test_nothing_is_found(name, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("name", HOLDING)
def test_nothing_is_found(name, tmp_path):
    counts = fuzz(f"fuzzing.{name}", seconds=SECONDS, number=1, keep=tmp_path, seeds=SEEDS / name)
    assert not counts.findings, "\n\n".join(one.text for one in counts.findings)
    assert counts.runs > 2, "in whatever time the machine has"
    assert counts.kinds[DONE], "the sound seed is"
    assert counts.kinds[REFUSED]


def test_every_way_to_fail_is_found_and_kept(tmp_path):
    seeds = tmp_path / "seeds"
    seeds.mkdir()
    for number, way in enumerate(faulty_fuzzer.WAYS):
        (seeds / f"{number}.txt").write_text(way)
    counts = fuzz(
        "faulty_fuzzer", seconds=0.0, number=1, keep=tmp_path / "found", seeds=seeds, limits=Limits(seconds=1.0)
    )
    assert counts.kinds == {DONE: 1, REFUSED: 2, "traceback": 1, "hang": 1, "memory": 1, "signal": 2}
    assert sorted(one.kind for one in counts.findings) == ["hang", "memory", "signal", "signal", "traceback"]
    for one in counts.findings:
        assert "at it" in one.text, one
        assert one.files[0].read_text() in (one.kind, "exit")
        assert one.kind in FINDINGS
        assert replay("faulty_fuzzer", one.files[0], Limits(seconds=1.0))[0] == one.kind
    found = {one.kind: one.place for one in counts.findings}
    assert "IndexError at" in found["traceback"]
    assert "faulty_fuzzer.py" in found["traceback"]


def test_cases_are_those_of_the_seed(tmp_path, monkeypatch):
    def drawn(number):
        monkeypatch.setattr("fuzzing.harness.Child.run", lambda _, file: (DONE, taken.append(file.read_bytes()) or ""))
        taken = []
        fuzz("faulty_fuzzer", seconds=60.0, number=number, keep=tmp_path, most=20)
        return taken

    assert drawn(3) == drawn(3) != drawn(4)
