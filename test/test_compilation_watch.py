"""What a first start says of its compilation: how far it is, and what is left, by what was compiled."""

from __future__ import annotations

from io import StringIO

import numba
import pytest
from rich.console import Console

from cable_twin.mechanics.language.compilation import FROM_KERNELS, FROM_PYTHON, kept_kernels, kernel
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation, first_compilation
from cable_twin.simulation.engine import Engine
from cable_twin.simulation.first_compilation import Moment, watching_compilation, work_ahead
from cable_twin.terminal import bars
from cable_twin.terminal.bars import BEGIN, compilation_shown

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


def new_kernels():
    """A kernel that is in no cache, of another type with every call, with one that it calls."""

    @kernel
    def doubled(x):
        return x + x

    @kernel
    def quadrupled(x):
        return doubled(doubled(x))

    return quadrupled


@pytest.mark.parametrize(("name", "kernels"), [("aerial_tramway", 150), ("chairlift", 240)])
def test_all_that_a_first_start_compiles_is_counted(name, kernels):
    """Once the scenario has started, what was ahead is done: the bar ends where the start ends."""
    scenario = load_scenario(name)
    Simulation(scenario).advance_to(0.02)
    ahead, kept = work_ahead(Engine(scenario)), kept_kernels(0.0)
    assert len(ahead) > kernels
    assert sum(size for name, size in ahead.items() if name in kept) > 0.97 * sum(ahead.values())
    assert {(FROM_PYTHON, "generalized_alpha.advance"), (FROM_KERNELS, "element.add_cable")} <= set(ahead)


def test_what_is_compiled_is_told_with_its_name_and_nothing_where_nothing_is(monkeypatch):
    monkeypatch.setattr(first_compilation, "PERIOD", 0.001)
    moments: list[Moment] = []
    with watching_compilation(moments.append):
        pass
    assert moments == []
    with watching_compilation(moments.append):
        assert new_kernels()(3.0) == 12.0
    names = {moment.kernel for moment in moments}
    assert "quadrupled" in names
    assert names <= {"quadrupled", "doubled", ""}
    assert all(0.0 <= moment.share <= 1.0 and moment.elapsed >= 0.0 for moment in moments)


def test_what_is_left_follows_from_the_speed_so_far():
    assert Moment(0.25, "chain", 10.0).remaining == pytest.approx(30.0)
    assert Moment(0.01, "chain", 10.0).remaining is None  # a guess
    assert Moment(0.99, "integrate", 60.0).remaining is None  # not 1 s or 0 s: what links them takes some seconds
    assert Moment(1.0, "integrate", 10.0).remaining is None  # what else there is was not known


@pytest.mark.parametrize("terminal", [False, True])
def test_a_bar_is_for_terminals_and_lines_for_the_rest(monkeypatch, terminal):
    def watching(shown):
        for share in (0.0, 0.05, 0.5, 0.6, 0.75):
            shown(Moment(share, "condense_chain", 20.0 * share))
        yield

    monkeypatch.setattr(bars, "watching_compilation", bars.contextmanager(watching))
    output, lines = StringIO(), []
    with compilation_shown(Console(file=output, force_terminal=terminal, width=100), lines.append):
        pass
    assert lines[-1].startswith("kernels compiled in ")
    if terminal:
        assert len(lines) == 1
        assert "condense_chain" in output.getvalue()
        assert "about 5 s left" in output.getvalue()
    else:
        assert lines[:-1] == [BEGIN, "compiling: 50 %, about 10 s left", "compiling: 75 %, about 5 s left"]
        assert output.getvalue() == ""
