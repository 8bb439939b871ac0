"""YAML of files and messages, read within limits of bytes, depth and values; data written as YAML.

A few lines of aliases can stand for very many values: values are counted, aliases expanded, before any is made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import AliasEvent
from ruamel.yaml.nodes import MappingNode, Node, SequenceNode
from ruamel.yaml.representer import SafeRepresenter

from cable_twin.basics.printable import printable

LARGEST = 2**20  # bytes
DEEPEST = 60  # lists and mappings within each other
LONGEST_LINE, LONGEST_GIVEN = 400, 60  # characters of a fault, and of what is given in it
MOST = 100_000  # values and keys, those of an alias each time that it stands


class UnreadableYamlError(ValueError):
    """Error for a text that is not valid YAML or exceeds the limits: reason, what is allowed, and line number.

    Attributes:
        where: number of the line as in ":12", or empty.
    """

    def __init__(self, reason: str, line: int | None = None) -> None:
        super().__init__(reason)
        self.where = "" if line is None else f":{line}"


class Double(NamedTuple):
    """Duplicate key in a mapping of a YAML text: path of the key, and both lines."""

    path: tuple[str | int, ...]
    first: int  # line
    second: int


class Document(NamedTuple):
    """Parsed YAML text: Python content, nodes with line numbers, and duplicate keys."""

    content: Any
    node: Node | None
    doubles: list[Double]


def limited_text(file: Path, largest: int = LARGEST) -> str:
    """Read a file of limited size in bytes as UTF-8 text.

    Raises:
        OSError: the file cannot be read.
        UnicodeDecodeError: the file is not UTF-8 text.
        UnreadableYamlError: the file is larger.
    """
    with file.open("rb") as stream:
        content = stream.read(largest + 1)
    _check_size(len(content), largest)
    return content.decode("utf-8-sig")


def read_yaml(text: str) -> Document:
    """Parse a text as YAML 1.2, in which 1e6 is a number.

    Raises:
        UnreadableYamlError: the text is not YAML, or exceeds a limit.
    """
    _check_size(len(text), LARGEST)
    yaml = YAML(typ="safe", pure=True)
    yaml.allow_duplicate_keys = True  # found by the composer, all of them
    yaml.Composer = _LimitedComposer
    try:
        content = yaml.load(text)
        return Document(content, yaml.composer.root, yaml.composer.doubles)
    except UnreadableYamlError:
        raise
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        reason = getattr(error, "problem", None) or getattr(error, "context", None) or str(error)
        line = mark.line + 1 if mark else None
        raise UnreadableYamlError(f"not YAML ({' '.join(str(reason).split())}); allowed: YAML 1.2", line) from None
    except Exception as error:  # the library raises many kinds for invalid values
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UnreadableYamlError(f"holds a value that cannot be read ({reason}); allowed: YAML 1.2") from None


def read_mapping(file: Path, error: Callable[[str], Exception], what: str, keys: Iterable[str]) -> Mapping[Any, Any]:
    """Read the mapping that a YAML file consists of.

    Args:
        file: its path; `~` stands for the home of the user.
        error: makes the exception that is raised, from a text with one line per fault.
        what: allowed contents of the file, as "load cases", for messages.
        keys: allowed keys of the mapping, for the message about a file with something else.

    Raises:
        error: the file cannot be read, is no YAML, gives a key twice, or holds no mapping.
    """
    try:
        found = read_yaml(limited_text(file.expanduser()))
    except UnreadableYamlError as fault:
        raise error(f"{file}{fault.where}: {fault}") from None
    except UnicodeDecodeError as fault:
        raise error(f"{file}: not a text in UTF-8 (byte {fault.start}); allowed: a YAML file of {what}") from None
    except (OSError, RuntimeError, ValueError) as fault:  # RuntimeError: ~ of a user without a home
        reason = getattr(fault, "strerror", None) or fault
        raise error(f"{file}: cannot be read ({reason}); allowed: a YAML file of {what}") from None
    twice = [(".".join(map(str, one.path)), one.first, one.second) for one in found.doubles]
    if twice:
        lines = (f"{file}: {path}: given on lines {one} and {two}; allowed: once" for path, one, two in twice)
        raise error("\n".join(printable(line, LONGEST_LINE) for line in lines))
    if not isinstance(found.content, Mapping):
        given = "nothing" if found.content is None else printable(repr(found.content), LONGEST_GIVEN)
        raise error(f"{file}: given {given}; allowed: a mapping with {', '.join(keys)}")
    return found.content


class _LimitedComposer(Composer):
    """YAML composer that counts values and depth, aliases included."""

    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader)
        self.warn_double_anchors = False  # YAML 1.2 lets the later one count
        self.root: Node | None = None
        self.doubles: list[Double] = []
        self._above, self._count, self._deepest = 0, 0, 0
        self._sizes: dict[int, tuple[int, int]] = {}  # of whole nodes, by identity: count, and depth below

    def get_single_node(self) -> Node | None:
        """Compose the root node of a YAML text, and find keys given twice."""
        self.root = super().get_single_node()
        self.doubles = list(_doubles(self.root, (), set()))  # before merge keys are put in their places
        return self.root

    def compose_node(self, parent: Node | None, index: Any) -> Node | None:
        """Compose one node with all nodes below, within the limits."""
        is_alias = self.parser.check_event(AliasEvent)
        line = self.parser.peek_event().start_mark.line + 1
        count, deepest, self._deepest = self._count, self._deepest, self._above
        self._above += 1
        self._check(self._above, line)
        node = super().compose_node(parent, index)
        self._above -= 1
        if is_alias:
            if id(node) not in self._sizes:
                raise UnreadableYamlError(
                    "an alias within its own anchor; allowed: an alias after the anchored value", line
                )
            inner, below = self._sizes[id(node)]
            self._count += inner
            self._deepest = max(self._deepest, self._above + below)
        else:
            self._count += 1
            self._deepest = max(self._deepest, self._above + 1)
            self._sizes[id(node)] = self._count - count, self._deepest - self._above
        self._check(self._deepest, line)
        self._deepest = max(self._deepest, deepest)
        return node  # type: ignore[no-any-return]

    def _check(self, depth: int, line: int) -> None:
        if depth > DEEPEST:
            raise UnreadableYamlError(f"nested more than {DEEPEST} levels deep; allowed: at most {DEEPEST}", line)
        if self._count > MOST:
            text = f"more than {MOST} keys and values, each use of an alias counted in full; allowed: at most {MOST}"
            raise UnreadableYamlError(text, line)


def _doubles(node: Node | None, path: tuple[str | int, ...], seen: set[int]) -> Iterator[Double]:
    """All keys given twice in the mappings of a YAML text."""
    if id(node) in seen:
        return
    seen.add(id(node))
    if isinstance(node, SequenceNode):
        for number, item in enumerate(node.value):
            yield from _doubles(item, (*path, number), seen)
    if isinstance(node, MappingNode):
        lines: dict[str, int] = {}
        for key, value in node.value:
            word, line = str(key.value), key.start_mark.line + 1
            if word in lines:
                yield Double((*path, word), lines[word], line)
            lines.setdefault(word, line)
            yield from _doubles(value, (*path, word), seen)


def _check_size(size: int, largest: int) -> None:
    if size > largest:
        raise UnreadableYamlError(f"larger than {largest / 2**20:g} MB; allowed: at most {largest / 2**20:g} MB")


class _Representer(SafeRepresenter):
    """Writer of YAML floats with a decimal point: 1e-06 is a text in YAML 1.1, 1.0e-06 is a number."""

    def represent_float(self, value: float) -> Any:
        text = repr(value)
        return self.represent_scalar(
            "tag:yaml.org,2002:float", text.replace("e", ".0e") if "e" in text and "." not in text else text
        )


_Representer.add_representer(float, _Representer.represent_float)


def as_yaml(data: dict[str, Any]) -> str:
    """Data as YAML text, readable as YAML 1.1 and 1.2 alike."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Representer = _Representer
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # bodies in the order of the chain
    yaml.default_flow_style = None
    yaml.width = 120
    text = StringIO()
    yaml.dump(data, text)
    return text.getvalue()
