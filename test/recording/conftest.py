"""Logs to be read."""

from __future__ import annotations

import pytest
from logged_run import CARRIAGES, METADATA, write_run

from cable_twin.messages import topics
from cable_twin.recording.mcap_log import McapLog


@pytest.fixture
def directory(tmp_path):
    return tmp_path / "logs" / "2024-01-01T00-00-00"


@pytest.fixture
def finished(directory):
    with_clock = topics(CARRIAGES, clock=True)  # a channel without messages
    log = McapLog(directory, with_clock, METADATA)
    messages = write_run(log, 40)
    log.close()
    return log, messages
