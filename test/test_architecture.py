"""House of docs/development.md: layers of folders, allowed imports between them, sizes of files and functions."""

from __future__ import annotations

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import cable_twin

PACKAGE = Path(cable_twin.__file__).resolve().parent
OUTSIDE = ("rclpy", "mcap", "rerun", "pydantic", "rosbags", "gymnasium", "ruamel", "rich", "zstandard")

# files and folders directly in the package, and in the mechanics: each imports of those before it alone
ROOMS = (
    *("basics", "mechanics", "scenario", "frame", "geometry", "key_figures", "simulation", "messages", "view"),
    *("terminal", "kernels", "ensemble", "gym", "recording", "offline", "runtime", "ros"),
)
FLOORS = ("language", "parameters", "state", "rope", "on_rope", "drives", "readout", "solution")
MOST_ROOMS, MOST_ARROWS, MOST_ARROWS_OF_MECHANICS = 17, 80, 25
MOST_LINES = {"file": 600, "function": 100}  # what a reader keeps in mind at once; what is one thought stays one file


@cache
def modules() -> dict[str, Path]:
    """All modules of the package by name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        if name:
            found[name] = path
    return found


@cache
def tree(path: Path) -> ast.Module:
    """Syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(name: str, at_once: bool = False) -> set[str]:
    """Imported modules of the package: all, or only those `at_once` on import."""
    known, found = modules(), set()
    for node in tree(known[name]).body if at_once else ast.walk(tree(known[name])):
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


def arrows(within: str = "") -> set[tuple[str, str]]:
    """Imports between the folders of the package, or between those of a part of it."""

    def room(module: str) -> str:
        return module.removeprefix(within).split(".")[0]

    inside = [name for name in modules() if name.startswith(within)]
    return {
        (room(name), room(module))
        for name in inside
        for module in imports(name)
        if module.startswith(within) and room(module) != room(name)
    }


@pytest.mark.parametrize(
    ("within", "order", "most"), [("", ROOMS, MOST_ARROWS), ("mechanics.", FLOORS, MOST_ARROWS_OF_MECHANICS)]
)
def test_imports_point_down_and_are_few(within, order, most):
    assert {name.removeprefix(within).split(".")[0] for name in modules() if name.startswith(within)} == set(order)
    assert len(order) <= MOST_ROOMS
    found = arrows(within)
    assert not [(source, target) for source, target in sorted(found) if order.index(target) > order.index(source)]
    assert len(found) <= most


def test_no_import_comes_round():
    graph = {name: {module for module in imports(name, at_once=True) if module != name} for name in modules()}
    TopologicalSorter(graph).prepare()  # raises CycleError with the circle


def test_mechanics_and_the_loop_of_a_running_twin_know_nothing_of_what_is_outside():
    for name, path in modules().items():
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Import | ast.ImportFrom):
                taken = {
                    (node.module or "") if isinstance(node, ast.ImportFrom) else alias.name for alias in node.names
                }
                outside = {module.split(".")[0] for module in taken} & set(OUTSIDE)
                assert not is_within(name, "mechanics") or not outside, f"{name}: {outside}"
                assert is_within(name, "ros") or "rclpy" not in outside, name


def test_kernels_call_what_their_cache_knows():
    """Sources that invalidate cached kernels: the mechanics and the kernel's own folder."""
    kernels = {"kernel", "brief_kernel", "inlined_kernel"}
    for name, path in modules().items():
        functions = [node for node in ast.walk(tree(path)) if isinstance(node, ast.FunctionDef)]
        used = {item.id for node in functions for item in node.decorator_list if isinstance(item, ast.Name)}
        if not is_within(name, "mechanics") and used & kernels:
            folder = name.rpartition(".")[0]
            assert folder, f"{name}: kernels stand in a folder, whose sources are few"
            wrong = {item for item in imports(name) if not is_within(item, "mechanics")}
            assert all(item.rpartition(".")[0] == folder for item in wrong), f"{name}: {wrong}"


def test_files_and_functions_are_short():
    long = {}
    for name, path in modules().items():
        sizes = {name: ("file", len(path.read_text(encoding="utf-8").splitlines()))}
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                sizes[f"{name}:{node.lineno} {node.name}"] = (
                    "function",
                    (node.end_lineno or node.lineno) - node.lineno + 1,
                )
        long |= {key: lines for key, (kind, lines) in sizes.items() if lines > MOST_LINES[kind]}
    assert not long


@pytest.mark.parametrize("package", ["scenario"])
def test_parts_of_a_package_do_not_lean_on_its_front(package):
    """Modules re-exported by an `__init__` do not import it."""
    for name in modules():
        if name.startswith(f"{package}."):
            assert package not in imports(name), name
