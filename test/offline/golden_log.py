"""Generator of `golden.mcap`, a log of the present format that later versions have to replay:

.venv/bin/python test/offline/golden_log.py
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from cable_twin.frame.records import Command
from cable_twin.messages import FrameNames, TopicNames, topics
from cable_twin.offline.script import ScriptedCommand
from cable_twin.offline.scripted_run import simulate
from cable_twin.recording.run import start_run
from cable_twin.recording.splitting import UNSPLIT
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

GOLDEN = Path(__file__).with_name("golden.mcap")
EPOCH = 1_795_000_000_123_456_789  # ns
PERIOD = 0.2  # s, of a frame
COMMANDS = {
    0.0: Command("payload", {"cabin": 3200.0}),
    0.2: Command("wind", {"x": 12.0, "z": 0.5}),
    0.6: Command("force", {"cabin": 60e3}),
    3.0: Command("speed", {"cabin": 2.0}),
    5.0: Command("emergency_stop", {}),
}


def main() -> None:
    simulation = Simulation(load_scenario("aerial_tramway", {"cable.elements": 60}))
    script = [ScriptedCommand(time, command, "script", "") for time, command in COMMANDS.items()]
    with tempfile.TemporaryDirectory() as directory:
        run = start_run(
            simulation,
            topics(simulation.layout),
            record_directory=Path(directory),
            frame_period=PERIOD,
            rerun="none",
            splitting=UNSPLIT,
            names=TopicNames("/south/cable_twin", {"joint_states": "/js"}),
            frames=FrameNames("south/map", "south/"),
        )
        run.begin(EPOCH)
        steps = round(PERIOD / simulation.step)
        outcome = simulate(simulation, script, duration=6.0, frame_steps=steps, epoch_ns=EPOCH, run=run, rates={})
        run.close()
        assert (outcome.refused, outcome.fault, run.recorder.faults) == ([], "", [])
        shutil.copy(next(run.directory.glob("*.mcap")), GOLDEN)


if __name__ == "__main__":
    main()
