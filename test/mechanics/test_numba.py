"""Ceiling on numba: private parts that the language of the mechanics needs and a new version may change."""

from __future__ import annotations

import ast
import configparser
import inspect
import re
from importlib import import_module
from pathlib import Path

import numba
import pytest
from numba.core import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult, Flags, _make_subtarget
from numba.core.datamodel import default_manager

from cable_twin.mechanics.language.compilation import _OPTIONS, Kernel, kernel
from cable_twin.mechanics.language.kernel_cache import MECHANICS
from cable_twin.mechanics.language.target import target, target_context

ROOT = Path(__file__).resolve().parents[2]
LANGUAGE = MECHANICS / "language"
ADVICE = """
The kernels of cable_twin/mechanics/language lean on private parts of numba. Before the ceiling is raised in setup.cfg,
these have to pass with the new numba, from an empty cache (NUMBA_CACHE_DIR=$(mktemp -d)):
  python -m pytest test/mechanics/test_numba.py            what is leant on, by name
  python -m pytest test/mechanics test/test_first_compilation.py
  python -m pytest test/offline                            the golden logs among them
  python -m benchmarks startup frame                       a start and a frame take no longer than before
docs/development.md says what each part is for."""


def bounds() -> tuple[str, str]:
    """Lowest and highest allowed numba version of setup.cfg."""
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg")
    (line,) = re.findall(r"^numba(.*)$", setup["options"]["install_requires"], re.MULTILINE)
    floor, ceiling = re.fullmatch(r">=([\d.]+),<([\d.]+)", line).groups()
    return floor, ceiling


def numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:2])


def imported() -> list[tuple[str, str, str]]:
    """File, module and name of all imports from numba and llvmlite in the language of the mechanics."""
    found = []
    for file in sorted(LANGUAGE.glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("numba", "llvmlite")):
                found += [(file.name, node.module or "", alias.name) for alias in node.names]
    return found


def test_numba_is_below_the_ceiling():
    floor, ceiling = bounds()
    assert numbers(floor) <= numbers(numba.__version__) < numbers(ceiling), (
        f"numba {numba.__version__} is installed, setup.cfg allows {floor} to below {ceiling}.{ADVICE}"
    )


@pytest.mark.parametrize(("file", "module", "name"), imported())
def test_names_are_there(file, module, name):
    try:
        getattr(import_module(module), name)
    except (ImportError, AttributeError):
        pytest.fail(f"numba {numba.__version__} has no {module}.{name}, which {file} takes from it.{ADVICE}")


def test_arrays_have_the_words_that_records_write():
    """Memory layout of numba's arrays: two owners, sizes, address, shape and strides."""
    model = default_manager.lookup(types.Array(types.float64, 2, "C"))
    words = [str(part.get_value_type()) for part in model._models]
    assert words == ["i8*", "i8*", "i64", "i64", "double*", "[2 x i64]", "[2 x i64]"], (
        f"numba {numba.__version__} lays arrays out otherwise: {words}.{ADVICE}"
    )


def test_options_are_known():
    """Undocumented options of numba used by `compilation`."""
    options = numba.core.registry.cpu_target.options
    known = {name for kind in options.__mro__ for name in vars(kind)}
    needed = {*_OPTIONS, "no_cpython_wrapper", "no_cfunc_wrapper", "forceinline"}
    assert needed <= known, f"numba {numba.__version__} knows no option {', '.join(needed - known)}.{ADVICE}"


def test_what_parts_replace_is_there():
    """Functions of numba overridden by `linking`: optimisation, translation and caching of libraries."""
    for name in (
        "finalize",
        "_optimize_functions",
        "_optimize_final_module",
        "_get_module_for_linking",
        "get_pointer_to_function",
        "serialize_using_object_code",
    ):
        assert callable(getattr(JITCodeLibrary, name, None)), f"numba {numba.__version__} has no {name}.{ADVICE}"
    library = JITCodeLibrary(numba.core.registry.cpu_target.target_context.codegen(), "library")
    assert hasattr(library, "_linking_libraries") and hasattr(library, "_shared_module"), ADVICE  # noqa: PT018
    assert len(library._codegen._function_pass_manager()) == 2, ADVICE
    assert callable(getattr(numba.core.registry.cpu_target.typing_context, "resolve_function_type", None)), ADVICE
    assert callable(getattr(library, "get_asm_str", None)), ADVICE
    kept = list(inspect.signature(CompileResult._rebuild).parameters)
    assert kept[:5] == ["target_context", "libdata", "fndesc", "env", "signature"], ADVICE


def test_a_context_takes_another_code_generator():
    """`target` gives one of its own to a copy of numba's context; code is kept apart by what that is for."""
    context = numba.core.registry.cpu_target.target_context
    own = target_context()
    assert own.codegen() is not context.codegen(), ADVICE
    triple, cpu, features, *_ = own.codegen().magic_tuple()
    assert (triple, cpu, features) == (context.codegen().magic_tuple()[0], target().cpu, target().features), ADVICE
    assert _make_subtarget(own, Flags()).codegen() is own.codegen(), ADVICE


def test_files_of_the_cache_are_known(tmp_path):
    """`kernel_cache` has places and stamps of its own for the files in which numba keeps code."""
    file = IndexDataCacheFile(str(tmp_path), "name", "fingerprint")
    file.save(("key",), {"data": 1})
    assert IndexDataCacheFile(str(tmp_path), "name", "fingerprint").load(("key",)) == {"data": 1}, ADVICE
    assert IndexDataCacheFile(str(tmp_path), "name", "another one").load(("key",)) is None, ADVICE
    assert ("key",) in file._load_index(), ADVICE
    assert callable(getattr(CompileResultCacheImpl, "reduce", None)), ADVICE
    assert list(inspect.signature(FunctionCache._index_key).parameters) == ["self", "sig", "codegen"], ADVICE


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="no kernels without the JIT")
def test_a_kernel_is_what_numba_takes_for_a_function():
    def twice(x):
        return 2.0 * x

    made = kernel(twice)
    assert isinstance(made, Kernel)
    assert isinstance(made._numba_type_, types.Dispatcher), ADVICE
    assert made._from_python.targetoptions["_nrt"] is False, ADVICE
    assert numba.njit(lambda x: made(x) + 1.0)(3.0) == 7.0, ADVICE
