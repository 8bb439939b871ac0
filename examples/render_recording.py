#!/usr/bin/env python3
"""Rendering of a rerun recording (.rrd) to PNG at given simulated times, without a screen.

A rerun viewer is started without a window, on the local interface only, and drawn by whatever Vulkan driver there
is; Mesa's software driver is enough. Example:

    python examples/render_recording.py run.rrd --time 5 --time 20 --output pictures/
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes.util
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from PIL import Image
from rerun.experimental import ViewerClient

DRIVER_DIRECTORIES = (Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"), Path("/usr/local/share/vulkan/icd.d"))
START_TIMEOUT = 60.0  # s, a software driver compiles its shaders at the first start
GREETING_TIME = 6.0  # s, for the viewer's greeting to fade
SETTLE_TIME = 6.0  # s, from moving the time cursor to a picture that shows all of it
TIMELINE = "sim_time"
MENU = 37  # pixels of the viewer's menu at the top, which is cut off
MAGIC = b"RRF"  # at the start of a recording


class RenderError(Exception):
    """Failed rendering; the message contains a remedy."""


def viewer_environment() -> dict[str, str]:
    """Return the environment for the viewer: Vulkan, by software if Mesa's driver is installed.

    Raises:
        RenderError: When there is no Vulkan loader or no driver.
    """
    environment = dict(os.environ, WGPU_BACKEND="vulkan")
    drivers = [path for directory in DRIVER_DIRECTORIES for path in sorted(directory.glob("*.json"))]
    chosen = environment.get("VK_ICD_FILENAMES") or environment.get("VK_DRIVER_FILES")
    if ctypes.util.find_library("vulkan") is None or not (drivers or chosen):
        raise RenderError(
            "no Vulkan driver found, and rerun draws with nothing else when there is no screen; "
            "on Debian or Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1"
        )
    software = [path for path in drivers if path.name.startswith("lvp_icd")]
    if software and not chosen:
        environment["VK_ICD_FILENAMES"] = str(software[0])
    return environment


def free_port() -> int:
    """Return a TCP port of the local interface that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def headless_viewer(recording: Path, size: str) -> Iterator[ViewerClient]:
    """Start a viewer without a window on `recording` and yield a client to it; end it with all its children.

    Args:
        recording: The .rrd file.
        size: Width and height of the picture, as in `1600x900`.

    Yields:
        A connected `ViewerClient`, once the recording is loaded.

    Raises:
        RenderError: When the viewer ends or does not answer.
    """
    port = free_port()
    arguments = ["--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", size, str(recording)]
    with tempfile.TemporaryFile() as output:
        # The rerun command is a wrapper around the viewer: only a group of their own ends both.
        process = subprocess.Popen(
            [sys.executable, "-m", "rerun", *arguments],
            env=viewer_environment(),
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            yield _connect(process, port, output)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=5.0)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _connect(process: subprocess.Popen, port: int, output: IO[bytes]) -> ViewerClient:
    """Wait until the viewer at `port` has loaded its recording and return a client to it."""
    deadline = time.monotonic() + START_TIMEOUT
    while time.monotonic() < deadline:
        if process.poll() is not None:
            output.seek(0)
            text = output.read().decode(errors="replace").strip()
            raise RenderError(f"the rerun viewer ended with code {process.returncode}:\n{text[-2000:]}")
        try:
            client = ViewerClient(f"rerun+http://127.0.0.1:{port}/proxy")
            state = client.get_state()
        except Exception:  # not listening yet; the client has no narrower error
            time.sleep(0.2)
            continue
        if not state.loading and any(recording.timelines for recording in state.recordings):
            return client
        time.sleep(0.2)
    raise RenderError(f"the rerun viewer did not load the recording within {START_TIMEOUT:g} s")


def render(recording: Path, times: list[float], output: Path, size: str) -> list[Path]:
    """Render `recording` at `times` (s); returns the PNG files.

    Args:
        recording: The .rrd file.
        times: Simulated times in seconds; where empty, the last one of the recording.
        output: A .png file for one time, or a directory.
        size: Width and height in pixels, as in `1600x900`.

    Raises:
        RenderError: When the recording is missing or no picture can be made.
    """
    if not recording.is_file():
        raise RenderError(f"no such recording: {recording}")
    with recording.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise RenderError(f"{recording}: not a rerun recording (.rrd)")
    with headless_viewer(recording, size) as client:
        if not times:
            ends = [line.end for shown in client.get_state().recordings for line in shown.timelines]
            times = [max(end for end in ends if end is not None) / 1e9]
        if output.suffix == ".png" and len(times) > 1:
            raise RenderError("several times need a directory as --output, not a .png file")
        pictures = []
        time.sleep(GREETING_TIME)
        for moment in times:
            picture = output if output.suffix == ".png" else output / f"{recording.stem}_{moment:08.3f}s.png"
            picture.parent.mkdir(parents=True, exist_ok=True)
            client.set_time(TIMELINE, duration=moment, play_state="paused")
            time.sleep(SETTLE_TIME)
            client.save_screenshot(str(picture.resolve()))
            _cut_menu(picture)
            pictures.append(picture)
    return pictures


def _cut_menu(picture: Path) -> None:
    with Image.open(picture) as image:
        image.crop((0, MENU, image.width, image.height)).save(picture)


def main() -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path, help="the .rrd file")
    parser.add_argument(
        "--time", type=float, action="append", default=[], metavar="S", help="simulated time, repeatable; default: end"
    )
    parser.add_argument("--output", type=Path, default=Path(), help="a .png file or a directory; default: here")
    parser.add_argument("--size", default="1600x900", metavar="WxH", help="pixels; default: 1600x900")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # an exception, so that the viewer is ended, too
    try:
        if sys.stderr.isatty():
            print(f"drawing {options.recording.name} without a screen: some ten seconds", file=sys.stderr)
        for picture in render(options.recording, options.time, options.output, options.size):
            print(picture)
    except RenderError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
