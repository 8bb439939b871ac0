"""Specialization: excluded branches are not compiled, and the remaining code gives equal results."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import pytest

from cable_twin.mechanics.language.by_reference import Known, by_reference, pack
from cable_twin.mechanics.language.compilation import inlined_kernel, kernel
from cable_twin.mechanics.language.specialization import known_fields, names_left
from cable_twin.mechanics.parameters import CONTINUUM
from cable_twin.scenario import build_system, load_scenario
from cable_twin.simulation.engine import leave_out_absent
from cable_twin.simulation.vehicle_contacts import with_buffers

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


@by_reference
class Extra(NamedTuple):
    """Optional part of a record."""

    present: Any
    size: float


@by_reference
class Whole(NamedTuple):
    """Record with an optional part."""

    extra: Extra
    model: Any
    weight: float


@kernel
def cannot_be_compiled(whole):
    """Function that numba cannot compile."""
    return whole.no_such_field


@inlined_kernel
def heavier(whole):
    """Condition in an inlined kernel."""
    if whole.extra.present:
        return cannot_be_compiled(whole)
    return 2.0 * whole.weight


@kernel
def by_model(whole):
    """Condition in a separate kernel."""
    if whole.model == 1:
        return cannot_be_compiled(whole)
    return heavier(whole)


@kernel
def outcome(whole):
    """Condition beside another one, and under a local name."""
    total = by_model(whole)
    absent = whole.extra
    for _ in range(3):
        if total > 0.0 and absent.present:
            total += cannot_be_compiled(whole)
    return total


@kernel
def counted(whole, times):
    """Known fields as numbers and conditions."""
    records = whole, whole
    one = records[times]
    return one.weight + one.model + (one.extra.present if times > 5 else times)


def test_what_is_known_to_be_absent_is_not_compiled():
    whole = Whole(Extra(Known(False), 1.0), Known(0), 3.0)
    assert outcome(whole) == 6.0
    assert outcome(whole._replace(weight=4.0)) == 8.0  # of the same type


def test_what_may_be_there_is():
    with pytest.raises(numba.errors.TypingError, match="no_such_field"):
        outcome(Whole(Extra(False, 1.0), Known(0), 3.0))


def test_a_known_value_is_one_where_nobody_looks_for_it():
    """Known field of a record found while the kernel runs."""
    assert counted(Whole(Extra(Known(True), 1.0), Known(3), 3.0), 1) == 7.0


def test_names_of_what_is_left():
    kinds = (numba.typeof(pack(Whole(Extra(Known(False), 1.0), Known(0), 3.0))),)
    assert known_fields(kinds) == {"present", "model"}
    assert names_left(heavier.py_func, kinds) == {"bool"}  # of the condition itself
    kinds = (numba.typeof(pack(Whole(Extra(True, 1.0), 0, 3.0))),)
    assert known_fields(kinds) == set()
    assert names_left(heavier.py_func, kinds) == {"bool", "cannot_be_compiled"}


def test_ropes_of_one_scenario_are_of_one_type():
    """Features of one rope in the kernels of all ropes, which are common."""
    scenario = load_scenario("single_span")
    system = with_buffers(build_system(scenario), scenario)
    paper = system._replace(cable=system.cable._replace(elastic_model=1))
    moving = system._replace(moving_cable=system.moving_cable._replace(moving=True))
    for systems, fields in (
        ([system], {"elastic_model", "moving", "number", "present"}),
        ([paper], {"moving", "number", "present"}),
        ([moving], {"elastic_model"}),  # as of several
        ([system, moving], {"elastic_model"}),
        ([system, paper], set()),
    ):
        kinds = {numba.typeof(pack(one)) for one in leave_out_absent(systems)}
        assert len(kinds) == 1
        assert known_fields(tuple(kinds)) == fields
    assert leave_out_absent([system])[0].cable.elastic_model == CONTINUUM
