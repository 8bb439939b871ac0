"""Recorded logs for the tests of readers."""

from __future__ import annotations

import pytest
from logged_run import LAYOUT, open_log, write_run

from cable_twin.messages import topics
from cable_twin.messages.columns import COLUMNS_TOPIC


@pytest.fixture
def directory(tmp_path):
    return tmp_path / "logs" / "2024-01-01T00-00-00"


@pytest.fixture
def finished(directory):
    with_clock = (*topics(LAYOUT, clock=True), COLUMNS_TOPIC)  # a channel without messages
    log = open_log(directory, with_clock)
    messages = write_run(log, 40)
    log.close()
    return log, messages
