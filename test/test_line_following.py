"""Chairlift that is followed: payloads of chairs by the load cells of towers, and a wrong plan."""

from __future__ import annotations

import pytest

from verification.following_line import follow

MOST = 40.0  # kg
DURATION = 90.0  # s, in which the first chairs pass two towers


@pytest.mark.long
def test_payload_of_each_chair_is_found_once_it_has_passed_two_load_cells():
    said: list[str] = []
    found = list(follow(1, DURATION, said))
    assert not [line for line in said if "sensor" in line]
    assert [line for line in said if "in the plan" in line]
    payloads = [one for one in found if one.name == "payload" and one.cells >= 2]
    assert len(payloads) > 20
    assert sum(abs(one.error) > MOST for one in payloads) < 0.05 * len(payloads)
