"""Pictures of README.md and docs/: made by the commands beside them, and in agreement with their captions."""

from __future__ import annotations

import re

import pytest

pytest.importorskip("PIL")  # comes with rerun
from cable_twin.scenario import scenario_names
from examples.pictures import IMAGE, MEASURED, PICTURES, pages, pictures, run, signature

KNOWN = pictures()
SIGNED = [name for name, picture in KNOWN.items() if picture.page != MEASURED]
OFFLINE = [name for name in SIGNED if "bin/sim " not in KNOWN[name].commands]
AGAIN = "python -m examples.pictures"
NUMBER = r"-?\d+(?:\.\d+)?"


def numbers(text: str) -> list[float]:
    return [abs(float(number)) for number in re.findall(NUMBER, text)]


def unsaid(caption: str, commands: str, output: str) -> list[str]:
    """Numbers of a caption that neither commands nor output contain; angles must be in the output."""
    missing = []
    for number, unit in re.findall(rf"({NUMBER})(?: (degrees))?", caption):
        lines = [line for line in output.splitlines() if "swing" in line and " deg " in line]
        decimals = len(number.partition(".")[2])
        said = numbers("\n".join(lines) if unit else commands + output)
        if abs(float(number)) not in {round(value, decimals) for value in said}:
            missing.append(f"{number} {unit}".strip())
    name = caption.partition(":")[0]
    return missing + [name] * (name in scenario_names() and name not in commands + output)


def test_every_picture_has_commands_and_a_page():
    shown = {name for page in pages() for _, name in IMAGE.findall(page.read_text(encoding="utf-8"))}
    files = {file.stem for file in PICTURES.glob("*.png")}
    assert shown == files == set(KNOWN)


@pytest.mark.parametrize("name", SIGNED)
def test_a_picture_was_made_by_the_commands_beside_it(name):
    assert signature(PICTURES / f"{name}.png").get("commands") == KNOWN[name].commands, f"{AGAIN} {name}"


@pytest.mark.parametrize("name", SIGNED)
def test_a_caption_says_what_the_commands_showed(name):
    made = signature(PICTURES / f"{name}.png")
    for caption in KNOWN[name].captions:
        assert not unsaid(caption, made["commands"], made["output"]), caption


def test_a_wrong_caption_is_found():
    caption = "aerial_tramway: swing after a stop at 68 s, up to 17.0 degrees"
    commands, output = "simulate single_span\n- {time: 60}", " cabin: swing along the track  13.54  deg "
    assert unsaid(caption, commands, output) == ["68", "17.0 degrees", "aerial_tramway"]
    assert not unsaid("single_span: a stop at 60 s, up to 13.5 degrees", commands, output)


@pytest.mark.long
@pytest.mark.parametrize("name", OFFLINE)
def test_commands_show_today_what_the_caption_says(name, tmp_path):
    """Same run again, without drawing recordings, which needs Vulkan, and pages, which needs Chromium."""
    picture = KNOWN[name]
    (tmp_path / "docs" / "pictures").mkdir(parents=True)
    (tmp_path / "work").mkdir()
    lines = picture.commands.splitlines(keepends=True)
    commands = "".join(line for line in lines if "render_recording" not in line and not line.startswith("chromium "))
    output = run(commands, tmp_path / "work", tmp_path / "docs")
    for caption in picture.captions:
        assert not unsaid(caption, picture.commands, output), caption
