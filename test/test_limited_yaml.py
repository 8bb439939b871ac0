"""Malicious YAML refused in a line: few lines standing for many values, or nested without end."""

from __future__ import annotations

import pytest

from cable_twin.basics import limited_yaml
from cable_twin.basics.limited_yaml import DEEPEST, LARGEST, MOST, UnreadableYamlError, read_mapping, read_yaml
from cable_twin.offline.script import ScriptError, read_script
from cable_twin.offline.simulate_options import parser
from cable_twin.scenario import ScenarioError, load_scenario, parse_scenario
from fuzzing.scenarios import bomb

FEW = 1000  # values; as many as are allowed take seconds
MANY = f"more than {MOST} keys and values, each use of an alias counted in full; allowed: at most {MOST}"
DEEP = f"nested more than {DEEPEST} levels deep; allowed: at most {DEEPEST}"
BOMBS = {kind: bomb(kind, levels=7, width=8) for kind in ("list", "map", "merge")}  # some 300,000 values
NESTED = {"lists": "- " * 200, "flow": "[" * 200, "maps": "{a: " * 200, "keys": "? " * 200}
NESTED |= {"aliases": "".join(f"- &a{number} [{f'*a{number - 1}' if number else 1}]\n" for number in range(100))}


@pytest.mark.parametrize("text", BOMBS.values(), ids=BOMBS)
def test_a_bomb_is_refused_wherever_yaml_is_read(text, tmp_path, capsys):
    file = tmp_path / "bomb.yaml"
    file.write_text(text)
    with pytest.raises(ScenarioError) as raised:
        load_scenario(file)
    line = int(str(raised.value).removeprefix(f"{file}:").partition(":")[0])
    assert line in (6, 7)
    assert str(raised.value) == f"{file}:{line}: {MANY}"
    with pytest.raises(ScenarioError) as raised:
        parse_scenario(text)
    assert str(raised.value) == f"text:{line}: {MANY}"
    with pytest.raises(ScriptError) as raised:
        read_script(file)
    assert str(raised.value) == f"{file}:{line}: {MANY}"
    with pytest.raises(SystemExit):
        parser().parse_args(["--set", f"terrain={text}"])
    assert "allowed: a value in YAML" in capsys.readouterr().err


@pytest.mark.parametrize("text", NESTED.values(), ids=NESTED)
def test_what_is_nested_without_end_is_refused(text, tmp_path):
    file = tmp_path / "deep.yaml"
    file.write_text(text)
    for read, error in ((load_scenario, ScenarioError), (read_script, ScriptError)):
        with pytest.raises(error) as raised:
            read(file)
        assert str(raised.value).startswith(str(file))
        assert str(raised.value).endswith(DEEP)


@pytest.mark.parametrize("suffix", [".yaml", ".csv"])
def test_files_without_end_are_not_read_to_it(suffix, tmp_path):
    file = tmp_path / f"endless{suffix}"
    with file.open("wb") as stream:
        stream.truncate(2**40)  # bytes, of which the disk has none
    with pytest.raises(ScriptError, match=r"larger than (\d+) MB; allowed: at most \1 MB$"):
        read_script(file)
    if suffix == ".yaml":
        with pytest.raises(ScenarioError, match=r"larger than 1 MB; allowed: at most 1 MB$"):
            load_scenario(file)


@pytest.mark.parametrize("text", ["&a [*a]", "x: &a {y: [1, *a]}", "&a {<<: *a}"])
def test_an_alias_within_itself_is_refused(text):
    with pytest.raises(UnreadableYamlError, match="an alias within its own anchor"):
        read_yaml(text)


@pytest.mark.parametrize("text", ["!!timestamp x", "!!float ''", "9" * 5000, "!!python/object:os.system x", "a: b: c"])
def test_values_that_are_none_are_refused_in_a_line(text):
    with pytest.raises(UnreadableYamlError, match=r"allowed: YAML 1\.2$") as raised:
        read_yaml(text)
    assert "\n" not in str(raised.value)


def test_what_is_within_limits_is_read(monkeypatch):
    monkeypatch.setattr(limited_yaml, "MOST", FEW)
    read = read_yaml("a: &a {x: 1e6}\nb: {<<: *a, y: [*a, *a]}\n")
    assert read.content == {"a": {"x": 1e6}, "b": {"x": 1e6, "y": [{"x": 1e6}, {"x": 1e6}]}}
    assert read_yaml("") == (None, None, [])
    assert len(read_yaml(f"[{'1,' * (FEW - 1)}]").content) == FEW - 1
    with pytest.raises(UnreadableYamlError, match=f"more than {FEW} keys and values"):
        read_yaml(f"[{'1,' * FEW}]")
    assert read_yaml("[" * (DEEPEST - 1) + "1" + "]" * (DEEPEST - 1)).content
    with pytest.raises(UnreadableYamlError, match="larger than"):
        read_yaml("#" * (LARGEST + 1))


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"a: [", ":1: not YAML"),
        (b"", ": given nothing; allowed: a mapping with a, b"),
        (b"- 1", ": given [1]; allowed: a mapping with a, b"),
        (b"a: 1\na: 2\nb: 1\nb: 2\n", ": a: given on lines 1 and 2; allowed: once\n"),
        (b"\xff", ": not a text in UTF-8 (byte 0); allowed: a YAML file of things"),
        (None, ": cannot be read (No such file or directory); allowed: a YAML file of things"),
    ],
)
def test_a_mapping_has_a_line_for_each_fault(tmp_path, content, told):
    file = tmp_path / "file.yaml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(KeyError) as error:
        read_mapping(file, KeyError, "things", ("a", "b"))
    (text,) = error.value.args
    assert text.startswith(f"{file}{told}")
    assert all(line.startswith(str(file)) for line in text.splitlines())
