"""The picture of the README's architecture section: which module may import which."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

import cable_twin

PACKAGE = Path(cable_twin.__file__).resolve().parent
OUTSIDE = ("rclpy", "mcap", "rerun", "pydantic", "rosbags", "gymnasium", "ruamel", "rich", "zstandard")

# what each room may import of the package besides itself, each below those that use it
ALLOWED = {
    "basics": (),
    "mechanics": ("basics",),
    "scenario": (
        "basics",
        "mechanics.parameters",
        "mechanics.solution.catenary",
        "mechanics.solution.bundle.records",
        "mechanics.solution.bundle.order",
    ),
    "frame": ("mechanics.readout", "scenario"),
    "geometry": ("frame", "mechanics.parameters", "mechanics.readout", "scenario"),
    "key_figures": ("basics", "frame", "geometry", "mechanics", "scenario"),
    "simulation": ("basics", "frame", "geometry", "mechanics", "scenario"),
    "messages": ("basics", "frame", "key_figures", "scenario"),
    "view": ("basics", "frame", "geometry"),
    "terminal": ("basics", "simulation"),
    "gym": ("frame", "scenario", "simulation"),
    "recording": ("basics", "frame", "geometry", "messages", "scenario", "simulation", "view"),
    "offline": (
        "basics",
        "frame",
        "geometry",
        "key_figures",
        "mechanics",
        "messages",
        "recording",
        "scenario",
        "simulation",
        "terminal",
        "view",
    ),
    "runtime": ("basics", "frame", "key_figures", "messages", "recording", "scenario", "simulation"),
    "ros": (
        "basics",
        "frame",
        "geometry",
        "key_figures",
        "messages",
        "recording",
        "runtime",
        "scenario",
        "simulation",
        "terminal",
        "view",
    ),
}
MOST_ROOMS, MOST_PATHS = 17, 80  # and arrows between them

# the same between the folders of the mechanics, and the two modules beside them
WITHIN_MECHANICS = {
    "language": (),
    "parameters": ("language",),
    "state": ("language", "parameters"),
    "rope": ("language", "parameters"),
    "on_rope": ("language", "parameters", "state", "rope"),
    "drives": ("language", "parameters", "rope", "on_rope"),
    "readout": ("language", "parameters", "rope", "on_rope", "drives"),
    "solution": ("language", "parameters", "state", "rope", "on_rope", "drives", "readout"),
}
MOST_ARROWS = 25

# what a reader keeps in mind at once; what is one thought stays one file
MOST_LINES = {"file": 600, "function": 100}


@cache
def modules() -> dict[str, Path]:
    """All modules by name within the package."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        if name:
            found[name] = path
    return found


@cache
def imports(name: str, path: Path) -> set[str]:
    """Modules of the package that a module imports anywhere, also within functions and for type checks."""
    known = modules()
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative import, which this test does not follow"
            module = node.module or ""
            for alias in node.names:
                inner = f"{module}.{alias.name}"
                found.add(inner if inner.removeprefix("cable_twin.") in known else module)
    return {item.removeprefix("cable_twin.") for item in found if item.startswith("cable_twin.")}


def is_within(module: str, part: str) -> bool:
    return module == part or module.startswith(f"{part}.")


def test_imports_point_down():
    wrong = {}
    for name, path in modules().items():
        part = name.split(".")[0]
        assert part in ALLOWED, f"{name} has no place in the picture"
        allowed = part, *ALLOWED[part]
        up = {module for module in imports(name, path) if not any(is_within(module, below) for below in allowed)}
        wrong |= {name: up} if up else {}
    assert not wrong


def test_rooms_are_few_and_none_leads_back():
    """Files and folders directly in the package, and imports between them; each stands below those that use it."""
    arrows = set()
    for name, path in modules().items():
        room = name.split(".")[0]
        arrows |= {(room, target) for target in {module.split(".")[0] for module in imports(name, path)} - {room}}
    assert len(ALLOWED) <= MOST_ROOMS
    assert len(arrows) <= MOST_PATHS
    seen: list[str] = []
    for room, below in ALLOWED.items():
        assert {module.split(".")[0] for module in below} <= set(seen), f"{room} stands beside or below what it uses"
        seen.append(room)


def test_the_loop_of_a_running_twin_knows_nothing_of_ros():
    for name, path in modules().items():
        if is_within(name, "runtime"):
            text = path.read_text(encoding="utf-8")
            assert "import rclpy" not in text, name
            assert "from rclpy" not in text, name


def test_mechanics_is_a_house_with_floors():
    """Arrows between the folders of the mechanics are few, and all point down: each part is below those that use it."""
    arrows = set()
    for name, path in modules().items():
        if is_within(name, "mechanics") and name != "mechanics":
            source = name.split(".")[1]
            targets = {module.split(".")[1] for module in imports(name, path) if is_within(module, "mechanics")}
            arrows |= {(source, target) for target in targets - {source}}
    wrong = {arrow for arrow in arrows if arrow[1] not in WITHIN_MECHANICS[arrow[0]]}
    assert not wrong
    assert len(arrows) <= MOST_ARROWS
    seen: list[str] = []
    for part, below in WITHIN_MECHANICS.items():
        assert set(below) <= set(seen), f"{part} stands beside or below what it uses"
        seen.append(part)


def test_kernels_call_what_their_cache_knows():
    """A kernel is compiled anew when a source of the mechanics or of its own folder has changed, and not otherwise."""
    kernels = {"kernel", "brief_kernel", "inlined_kernel"}
    for name, path in modules().items():
        defined = {decorator.id for decorator in decorators(path) if isinstance(decorator, ast.Name)}
        if not is_within(name, "mechanics") and defined & kernels:
            folder = name.rpartition(".")[0]
            assert folder, f"{name}: kernels stand in a folder, whose sources are few"
            wrong = {item for item in imports(name, path) if not is_within(item, "mechanics")}
            assert all(item.rpartition(".")[0] == folder for item in wrong), f"{name}: {wrong}"


def lengths(name: str, path: Path) -> dict[str, tuple[str, int]]:
    """Kind and number of lines of a module, and of all functions in it by name."""
    text = path.read_text(encoding="utf-8")
    found = {name: ("file", len(text.splitlines()))}

    def visit(node: ast.AST, within: str) -> None:
        for inner in ast.iter_child_nodes(node):
            called = within
            if isinstance(inner, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                called = f"{within}.{inner.name}"
                if not isinstance(inner, ast.ClassDef):
                    found[called] = ("function", (inner.end_lineno or inner.lineno) - inner.lineno + 1)
            visit(inner, called)

    visit(ast.parse(text), name)
    return found


def test_files_and_functions_are_short():
    found = [item for name, path in modules().items() for item in lengths(name, path).items()]
    assert not {key: count for key, (kind, count) in found if count > MOST_LINES[kind]}


def decorators(path: Path) -> list[ast.expr]:
    """Of all functions of a module."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [item for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) for item in node.decorator_list]


@pytest.mark.parametrize("package", ["scenario"])
def test_parts_of_a_package_do_not_lean_on_its_front(package):
    """What `__init__` gathers stands below it."""
    for name, path in modules().items():
        if name.startswith(f"{package}."):
            assert package not in imports(name, path), name
