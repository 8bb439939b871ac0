import numpy_of_the_class  # noqa: F401 - before anything imports numpy

# isort: split
import gc
import os
import runpy
import signal
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from kernels_in_turn import take_turns
from twin_process import TwinProcess, allocate_domain, release_domain, write_quick_scenario

from cable_twin.key_figures import KeyFigures
from cable_twin.mechanics.language.compilation import Kernel
from cable_twin.mechanics.language.linking import BriefCompiler
from cable_twin.mechanics.on_rope.load_node import update_load_nodes
from cable_twin.mechanics.rope.element import add_cable
from cable_twin.mechanics.solution.bundle.elimination import solve_bundle
from cable_twin.mechanics.solution.equations_of_motion import assemble, assemble_open, solve_accelerations
from cable_twin.mechanics.solution.newton import solve_increments
from cable_twin.mechanics.solution.relaxation import relax
from cable_twin.offline import replay
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

# whose kernels most tests need: several ropes and one, in space and in a plane
SHARED = "jig_back", "chairlift", "windy_tramway", "aerial_tramway"
LARGE = add_cable, assemble, assemble_open, solve_accelerations, solve_bundle, solve_increments, update_load_nodes
for large in LARGE:
    if isinstance(large, Kernel):  # only tests call it from Python: the same numbers, in half the time of compilation
        large._options["pipeline_class"] = BriefCompiler
# before anything imports rclpy: tests neither see other ROS 2 systems nor are seen by them
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under `nohup` all commands that tests start would ignore it


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Keep the tests of a file in one process under `-n`, in the given order, as they share twins and runs."""
    from xdist.scheduler import LoadFileScheduling  # noqa: PLC0415 - only there with `-n`

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Alternate files that wait for twins with files that compute under `-n`, so that no core is idle."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    files = list(dict.fromkeys(item.path for item in items))
    waiting = [file for file in files if file.parent.name in ("ros", "examples")]
    computing = [file for file in files if file not in waiting]
    places = {file: (index + 0.5) / len(kind) for kind in (waiting, computing) for index, file in enumerate(kind)}
    items.sort(key=lambda item: places[item.path])


@pytest.hookimpl(trylast=True)
def pytest_collection_finish():
    """Exempt the collected tests from garbage collection, which compilation triggers often."""
    gc.freeze()
    gc.set_threshold(100_000, 20, 20)
    if isinstance(relax, Kernel) and relax._from_python.signatures:
        raise pytest.UsageError("a file of tests simulates while it is imported: each process of -n compiles for that")


@pytest.fixture(scope="session", autouse=True)
def _ros_log_directory(tmp_path_factory):
    os.environ["ROS_LOG_DIR"] = str(tmp_path_factory.mktemp("ros_log"))


@pytest.fixture(scope="session", autouse=True)
def _kernels(tmp_path_factory):
    """Kernels needed by most tests, each scenario compiled by one process of `-n`."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    take_turns()
    gc.disable()
    for name in SHARED:
        with suppress(FileExistsError):  # another one has begun with it
            (tmp_path_factory.getbasetemp().parent / f"kernels_of_{name}").touch(exist_ok=False)
            simulation = Simulation(load_scenario(name))
            KeyFigures(simulation.scenario).update(simulation.advance_to(0.01))
    gc.enable()


@pytest.fixture
def processes(tmp_path):
    """Start commands of the package that are ended after the test in every case."""
    started = []

    def start(*arguments, **options):
        started.append(TwinProcess(tmp_path, *arguments, **options))
        return started[-1]

    yield start
    for process in started:
        process.kill()


@pytest.fixture
def ended(monkeypatch, capsys):
    """Run a module or script as `python -m` or `python` does, in this process; exit code, output and errors."""

    def run(program, *arguments):
        monkeypatch.setattr(sys, "argv", [*map(str, (program, *arguments))])
        monkeypatch.setattr(sys, "path", [str(Path(program).parent), *sys.path])
        with pytest.raises(SystemExit) as end:
            (runpy.run_path if isinstance(program, Path) else runpy.run_module)(str(program), run_name="__main__")
        return end.value.code or 0, *capsys.readouterr()

    return run


@pytest.fixture
def refusal(capsys):
    """Run the `main` of a command that refuses its arguments; the single line of its error, checked for its name."""

    def run(main, *arguments, code=2):
        capsys.readouterr()
        try:
            ended = main([*map(str, arguments)])
        except SystemExit as end:
            ended = end.code
        assert ended == code
        output, errors = capsys.readouterr()
        (line,) = errors.splitlines()
        assert line.startswith(f"{main.__module__.rpartition('.')[2]}: ")
        assert code != 2 or not output  # what cannot be used is said before anything is printed
        return line

    return run


@pytest.fixture
def replayed(capsys):
    """Replay a log of which every sample agrees to the last bit; the output."""

    def run(log):
        capsys.readouterr()
        assert replay.main([str(log)]) == 0
        output = capsys.readouterr().out
        assert output.splitlines()[-1] == "every sample agrees to the last bit"
        return output

    return run


@pytest.fixture
def no_display(monkeypatch):
    """Environment without a display, as on a server."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def domain():
    """ROS domain reserved for one test."""
    taken = allocate_domain()
    yield taken
    release_domain(taken)


@pytest.fixture
def participants():
    """Make nodes in the ROS domains of twins."""
    from ros_participant import Participant  # noqa: PLC0415 - not where rclpy is missing

    made = []

    def make(domain, **options):
        made.append(Participant(domain, **options))
        return made[-1]

    yield make
    for participant in made:
        participant.close()


@pytest.fixture
def quick_twin(processes, participants, tmp_path):
    """Start a twin of the quick scenario; its process, and a node with its standard topics."""

    def start(*arguments, paused=False, **options):
        process = processes("--scenario", str(write_quick_scenario(tmp_path)), *arguments, **options)
        participant = participants(process.domain)
        participant.subscribe_standard(paused=paused)
        return process, participant

    return start


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """Running twin without logs for a whole module, with a participant that talks to it."""
    from ros_participant import Participant  # noqa: PLC0415 - not where rclpy is missing

    directory = tmp_path_factory.mktemp("running")
    process = TwinProcess(directory, "--scenario", str(write_quick_scenario(directory)), "--record", "false")
    participant = Participant(process.domain)
    participant.subscribe_standard()
    yield process, participant
    participant.close()
    process.kill()
