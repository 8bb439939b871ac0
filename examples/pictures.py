#!/usr/bin/env python3
"""Pictures of README.md and docs/, made by the commands beside them.

    python -m examples.pictures                        all but those of docs/benchmarks.md, which need a quiet machine
    python -m examples.pictures softer_brake gondola   some of them

A block of commands makes the pictures whose files it names. It runs as it stands, in an empty directory with links to
`.venv`, `config`, `docs` and `examples`. What ran and what it printed is kept in the picture itself, where
`test/test_pictures.py` compares it with the block and with the caption. Needs '.[ros,plots]' and what
`examples/render_recording.py` needs.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from PIL import Image
from PIL.PngImagePlugin import PngInfo

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "pictures"
MEASURED = "benchmarks.md"  # times of a machine, which has to do nothing else meanwhile
BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)
IMAGE = re.compile(r"!\[([^]]*)\]\((?:docs/)?pictures/(\w+)\.png\)")
MADE = re.compile(r"docs/pictures/(\w+)\.png")
LINKS = ("config", "docs", "examples")


class Picture(NamedTuple):
    """Picture of the documentation."""

    page: str  # file name of the page whose commands make it
    commands: str
    captions: tuple[str, ...]  # of all pages that show it


def pages() -> list[Path]:
    """Paths of README.md and all pages of docs/."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def pictures() -> dict[str, Picture]:
    """Pictures made by blocks of commands, by name.

    Raises:
        ValueError: two blocks make the same one.
    """
    texts = {page.name: page.read_text(encoding="utf-8") for page in pages()}
    captions: dict[str, list[str]] = {}
    for text in texts.values():
        for caption, name in IMAGE.findall(text):
            captions.setdefault(name, []).append(" ".join(caption.split()))
    found: dict[str, Picture] = {}
    for page, text in texts.items():
        for block in BLOCK.findall(text):
            for name in dict.fromkeys(MADE.findall(block)):
                if name in found:
                    raise ValueError(f"{name}.png: made by a block of {found[name].page} and by one of {page}")
                found[name] = Picture(page, block, tuple(captions.get(name, ())))
    return found


def run(commands: str, directory: Path, docs: Path) -> str:
    """Run a block of commands in an empty directory; returns its output.

    Args:
        commands: of bash.
        directory: where it runs.
        docs: what it sees as `docs`.

    Raises:
        subprocess.CalledProcessError: a command failed.
    """
    for name in LINKS:
        (directory / name).symlink_to(docs if name == "docs" else ROOT / name)
    (directory / ".venv").symlink_to(Path(sys.executable).parents[1])
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    result = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", commands],
        cwd=directory,
        env={**os.environ, "PYTHONPATH": path, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return result.stdout


def sign(picture: Path, commands: str, output: str) -> None:
    """Store the commands of a picture and their output in its file."""
    notes = PngInfo()
    notes.add_itxt("commands", commands, zip=True)
    notes.add_itxt("output", output, zip=True)
    with Image.open(picture) as image:
        image.load()
        image.save(picture, pnginfo=notes, optimize=True)


def signature(picture: Path) -> Mapping[str, str]:
    """Texts stored by `sign`: "commands" and "output"."""
    with Image.open(picture) as image:
        image.load()
        return dict(image.info)


def main() -> int:
    """Run the command line and return the exit code."""
    known = pictures()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of pictures: {', '.join(known)}")
    names = parser.parse_args().names or [name for name, picture in known.items() if picture.page != MEASURED]
    if unknown := [name for name in names if name not in known]:
        parser.error(f"no commands make {', '.join(unknown)}; known: {', '.join(known)}")
    blocks = dict.fromkeys(known[name].commands for name in names)
    for block in blocks:
        made = [name for name, picture in known.items() if picture.commands == block]
        print(f"{known[made[0]].page}: {', '.join(made)}", flush=True)
        with tempfile.TemporaryDirectory() as directory:
            try:
                output = run(block, Path(directory), ROOT / "docs")
            except subprocess.CalledProcessError as error:
                print(
                    f"{error.stdout}\npictures: the commands ended with {error.returncode}:\n{block}", file=sys.stderr
                )
                return 1
        for name in made:
            sign(PICTURES / f"{name}.png", block, output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
