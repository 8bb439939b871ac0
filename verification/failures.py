"""Losses by failures of the machine under a running twin: kill, power cut, full or stalling disk.

Each case starts the node `sim` on a disk of its own: an ext4 file system in a file, mounted over a loop device, which
can be filled, stalled (`fsfreeze`), broken and switched off. A second process listens to the topics meanwhile. This
needs root on Linux. The tests run the same cases; this prints them as the table in docs/logs.md:

    sudo .venv/bin/python -m verification.failures
"""

from __future__ import annotations

import array
import fcntl
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from rich.progress import track

from cable_twin.messages import JOINT_STATES, SECOND, decode
from cable_twin.recording.log_reader import LogError, read_log

SIZE = 32 * 2**20  # bytes of the disk
STALL = 7.0  # s
HEARD = 0.05  # s after the failure in which a frame is taken for one of before it, so as not to lose too little
QUEUED = 0.3  # s after the failure in which frames of before it are heard
STARTING = 180.0  # s; the kernels may have to be compiled
SHUT_DOWN = 0x8004587D  # EXT4_IOC_SHUTDOWN of linux/fs/ext4/ext4.h
WITHOUT_JOURNAL = 2  # what is not on the disk is gone, as when the power goes


@dataclass
class Loss:
    """Losses of one failure."""

    failure: str
    said: str = ""  # by the node, a line
    rate: float | None = None  # Hz of frames after the failure; None where the node is gone
    lost: float | None = None  # ms of frames before the failure that cannot be read, and holes; None: no log at all
    replayed: bool | None = None  # whether `replay` agrees with what is left
    repaired: int | None = None  # messages that rosbags reads after `review --repair`
    messages: int = 0  # that are there


class Disk:
    """Small disk that can fail."""

    def __init__(self, directory: Path, stall_time: float = STALL) -> None:
        """Create the disk and mount it below a directory; raises OSError where not permitted."""
        self.image = directory / "disk.img"
        self.root = directory / "disk"
        self.stall_time = stall_time  # s
        self.root.mkdir()
        with self.image.open("wb") as stream:
            stream.truncate(SIZE)
        self._run("mkfs.ext4", "-q", "-F", "-m", "0", str(self.image))
        self._run("mount", "-o", "loop,errors=remount-ro", str(self.image), str(self.root))

    def fill(self) -> None:
        """Fill the disk completely."""
        with (self.root / "ballast").open("wb", buffering=0) as stream, suppress(OSError):
            for size in (2**20, 2**12):
                with suppress(OSError):
                    while stream.write(bytes(size)):
                        pass

    def stall(self) -> None:
        """Delay every write for a while, in the background."""
        self._run("fsfreeze", "--freeze", str(self.root))
        subprocess.Popen(["sh", "-c", f"sleep {self.stall_time}; fsfreeze --unfreeze '{self.root}'"])

    def cut_power(self) -> None:
        """Lose all data not written through, and refuse everything from now on."""
        descriptor = os.open(self.root, os.O_RDONLY)
        try:
            fcntl.ioctl(descriptor, SHUT_DOWN, array.array("I", [WITHOUT_JOURNAL]))
        finally:
            os.close(descriptor)

    def become_read_only(self) -> None:
        """Fail as a worn-out disk: the kernel finds an error and refuses writes."""
        device = Path(self._run("findmnt", "-n", "-o", "SOURCE", str(self.root)).strip()).name
        Path(f"/sys/fs/ext4/{device}/trigger_fs_error").write_text("worn out")

    def mount_again(self, *options: str) -> None:
        """Mount the disk again after the failure."""
        self.release()
        self._run("mount", "-o", ",".join(("loop", *options)), str(self.image), str(self.root))

    def release(self) -> None:
        """Unmount the disk."""
        self._run("umount", str(self.root))

    @staticmethod
    def _run(*command: str) -> str:
        try:
            return subprocess.run(command, check=True, capture_output=True, text=True).stdout
        except subprocess.CalledProcessError as error:
            raise OSError(f"{' '.join(command)}: {error.stderr.strip()}") from error


class Listener:
    """Receiver of the frames of a twin in another process, and driver of its cabin."""

    def __init__(self, domain: int) -> None:
        import rclpy  # noqa: PLC0415 - the cases without it can be listed
        from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415

        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("listener", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.heard: list[tuple[float, int]] = []  # clock (s) and stamp (ns) of each frame
        self._node.create_subscription(JointState, f"/cable_twin/{JOINT_STATES}", self._hear, 500, raw=True)
        publisher = self._node.create_publisher(JointState, "/cable_twin/joint_commands", 50)
        command = JointState(name=["cabin"], velocity=[3.0])
        self._node.create_timer(0.05, lambda: publisher.publish(command))

    def listen(self, seconds: float, until: Callable[[], Any] = lambda: False) -> None:
        """Take messages for a while."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline and not until():
            self._executor.spin_once(timeout_sec=0.02)

    def rate_after(self, moment: float) -> float:
        """Frames per second (Hz) of the clock after a moment."""
        later = [clock for clock, _ in self.heard if clock > moment]
        return (len(later) - 1) / (later[-1] - later[0]) if len(later) > 1 else 0.0

    def newest(self, moment: float) -> int:
        """Stamp (ns) of the last frame received until a moment."""
        return max(stamp for clock, stamp in self.heard if clock <= moment)

    def close(self) -> None:
        """Leave the ROS domain."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _hear(self, data: bytes) -> None:
        stamp = decode(data, "sensor_msgs/msg/JointState").header.stamp
        self.heard.append((time.monotonic(), stamp.sec * SECOND + stamp.nanosec))


def kill(disk: Disk, sim: subprocess.Popen) -> None:
    """`kill -9`."""
    sim.kill()


def cut_file(disk: Disk, sim: subprocess.Popen) -> None:
    """`kill -9`, and the last 10 kB of the bag are gone."""
    sim.kill()
    sim.wait()
    (bag,) = disk.root.glob("*/*.mcap")
    os.truncate(bag, bag.stat().st_size - 10_000)


def power_cut(disk: Disk, sim: subprocess.Popen) -> None:
    """Power cut: what the disk has not been given is gone."""
    disk.cut_power()
    sim.kill()


def disk_torn_out(disk: Disk, sim: subprocess.Popen) -> None:
    """Disk gone while the machine runs on."""
    disk.cut_power()


def full_disk(disk: Disk, sim: subprocess.Popen) -> None:
    """Full disk."""
    disk.fill()


def worn_out_disk(disk: Disk, sim: subprocess.Popen) -> None:
    """Disk that becomes read-only."""
    disk.become_read_only()


def stalling_disk(disk: Disk, sim: subprocess.Popen) -> None:
    """Disk that stalls for 7 s."""
    disk.stall()


def read_only_directory(disk: Disk, sim: subprocess.Popen) -> None:
    """Directory that is read-only from the start."""


FAILURES = (
    kill,
    cut_file,
    power_cut,
    disk_torn_out,
    full_disk,
    worn_out_disk,
    stalling_disk,
    read_only_directory,
)


def measure(
    failure: Callable[[Disk, subprocess.Popen], None],
    directory: Path,
    domain: int,
    scenario: str = "aerial_tramway",
    listening: float = 3.0,
    stall: float = STALL,
) -> Loss:
    """Run a twin, cause a failure, and read the remaining data.

    Args:
        failure: one of `FAILURES`.
        directory: empty; everything is made below it.
        domain: ROS domain of the twin.
        scenario: name or path; it needs a carriage `cabin`.
        listening: s of driving before the failure, and again after it.
        stall: s for which a stalling disk stalls.

    Raises:
        OSError: This machine does not let us mount a disk.
        RuntimeError: The twin did not start, or did not end as it should.
    """
    disk = Disk(directory, stall)
    loss = Loss((failure.__doc__ or "").rstrip("."))
    if failure is read_only_directory:
        disk.mount_again("ro")
    listener = Listener(domain)
    output = directory / "output.txt"
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_LOG_DIR": str(directory), "PYTHONUNBUFFERED": "1"}
    with output.open("w") as stream:
        sim = subprocess.Popen(
            [sys.executable, "-m", "cable_twin.ros.sim", "--scenario", scenario, "--record-directory", str(disk.root)],
            env=environment,
            stdout=stream,
            stderr=subprocess.STDOUT,
        )
    try:
        listener.listen(STARTING, lambda: listener.heard or sim.poll() is not None)
        if not listener.heard:
            raise RuntimeError(f"the twin did not start: {output.read_text()}")
        listener.listen(listening)
        failure(disk, sim)
        listener.listen(HEARD)  # what was published while it happened
        moment = time.monotonic()
        gone = failure in (kill, cut_file, power_cut)
        listener.listen(QUEUED if gone else listening + (stall if failure is stalling_disk else 0.0))
        if not gone:
            loss.rate = listener.rate_after(moment + QUEUED)
            sim.send_signal(signal.SIGINT)
            if sim.wait(30.0) != 0:
                raise RuntimeError(f"the twin ended with {sim.returncode}: {output.read_text()}")
        else:
            moment = time.monotonic()  # the last frames were still under way
            sim.wait(10.0)
        loss.said = _said(output.read_text())
        disk.mount_again()
        _look(loss, disk.root, listener.newest(moment), failure is stalling_disk)
    finally:
        sim.kill()
        sim.wait()
        listener.close()
        with suppress(OSError):
            disk.release()
    return loss


def _said(output: str) -> str:
    """First warning or error of the node about its bag, without time and node name."""
    words = ("log stopped", "nothing is recorded", "disk does not keep up")
    lines = [line for line in output.splitlines() if any(word in line for word in words)]
    return lines[0].partition("[cable_twin]: ")[2] if lines else ""


def _look(loss: Loss, root: Path, newest: int, whole: bool) -> None:
    """Read the data on the disk, by this package and by rosbags."""
    runs = [path for path in root.iterdir() if path.is_dir() and path.name != "lost+found"]
    if not runs:
        return
    (run,) = runs
    try:
        log = read_log(run)
        stamps = [stamp for _, stamp, _ in log.messages([JOINT_STATES])]
    except LogError as error:
        loss.said += f"; {error}"
        return
    loss.messages = sum(1 for _ in log.messages())
    frame = round(float(log.metadata["frame_period"]) * SECOND)
    holes = sum(after - before - frame for before, after in pairwise(stamps))
    end = newest if not whole else max(newest, stamps[-1])
    loss.lost = (max(end - stamps[-1], 0) + holes) / 1e6
    loss.replayed = _run_module("replay", str(run)).returncode == 0
    reviewed = _run_module("review", str(run), "--no-viewer")
    if reviewed.returncode != 0:
        loss.said += f"; {reviewed.stderr}"
    (root / "ballast").unlink(missing_ok=True)
    bag = run
    if not log.complete:
        _run_module("review", str(run), "--repair")
        bag = run.with_name(f"{run.name}_repaired")
    loss.repaired = _count_with_rosbags(bag)


def _run_module(module: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", f"cable_twin.offline.{module}", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _count_with_rosbags(bag: Path) -> int:
    """Number of messages read by rosbags."""
    from rosbags.highlevel import AnyReader  # noqa: PLC0415

    with AnyReader([bag]) as reader:
        return sum(1 for _ in reader.messages())


def row(loss: Loss) -> str:
    """Table row of one loss."""
    rate = "-" if loss.rate is None else f"{loss.rate:.1f}"
    lost = "all, nothing is recorded" if loss.lost is None else f"{loss.lost:.0f}"
    replayed = {None: "-", True: "agree", False: "**differ**"}[loss.replayed]
    others = "-" if loss.repaired is None else f"{loss.repaired} of {loss.messages}"
    return f"| {loss.failure} | {loss.said or '-'} | {rate} | {lost} | {replayed} | {others} |"


def main() -> int:
    """Print the table; returns 1 when more than a second of a log is lost."""
    print("| failure | the node says | frames after it [Hz] | lost [ms] | `review`, `replay` | rosbags |")
    print("| --- | --- | --- | --- | --- | --- |")
    code = 0
    for failure in track(FAILURES, description="breaking", disable=not sys.stdout.isatty()):
        with tempfile.TemporaryDirectory() as directory:
            loss = measure(failure, Path(directory), random.randrange(20, 100))
        print(row(loss), flush=True)
        code |= loss.lost is not None and loss.lost > 1000.0
    return code


if __name__ == "__main__":
    sys.exit(main())
