"""Twin that follows a plant: no outlook begins while it makes up for a distance; it is not well while it is late."""

from __future__ import annotations

from concurrent.futures import Future
from io import BytesIO
from types import SimpleNamespace

import pytest

from cable_twin.runtime.companion import receive
from cable_twin.runtime.following import FOLLOWING, Estimated, LiveFollowing
from cable_twin.runtime.outlook import LiveOutlook, Question
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

COARSE = {"cable.elements": {"target": 20.0, "at_towers": 6.0, "growth": 1.7}}  # for speed


@pytest.mark.parametrize("passing", [[True, True, False], [False]])
def test_no_outlook_begins_while_a_speed_will_not_last(passing):
    """The process ends with its first question; the state is looked at until one may be asked."""
    simulation, captured, answers = Simulation(load_scenario("aerial_tramway", COARSE)), [], iter(passing)

    def capture():
        captured.append(future := Future())
        future.set_result(simulation.capture())
        return future

    outlook = LiveOutlook(
        simulation,
        SimpleNamespace(capture=capture),
        stamp_ns=lambda time: round(1e9 * time),
        publish=pytest.fail,
        warn=pytest.fail,
        horizon=60.0,
        rate=1000.0,
        gust=10.0,
        passing=lambda: next(answers),
    )
    questions = BytesIO()
    outlook.talk(questions, BytesIO())
    questions.seek(0)
    assert receive(questions)["horizon"] == 60.0
    assert isinstance(receive(questions), Question)
    assert receive(questions) is None
    assert len(captured) == len(passing)


@pytest.mark.parametrize(("behind", "well", "said"), [(4.0, True, "follows"), (19.0, False, "19 s behind the plant")])
def test_a_twin_that_is_behind_its_plant_is_not_well(behind, well, said):
    following = LiveFollowing(load_scenario("aerial_tramway"), pytest.fail, pytest.fail)
    following._last = Estimated(7.0, b"", (), FOLLOWING, {}, {}, behind)
    assert following.status()[0] == well
    assert following.status()[1].endswith(said)
