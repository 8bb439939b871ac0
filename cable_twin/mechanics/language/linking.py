"""Compilation passes and linking of kernels: a called kernel is kept as bitcode and compiled within its callers.

numba would optimise each kernel, and translate it, anew in every caller and in that one's callers, up to the one that
Python calls. Here this is done once, in that one: half of the time that LLVM takes in a first start. The machine code
is the same, as LLVM sees the same. The passes of numba that kernels have no use for are left out as well.

The type of an operation on numbers and arrays is found once in a process: numba tries its meanings for texts, lists and
sets each time that it meets one. That saves 3 to 6 % of a first compilation.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain
from typing import Any
from uuid import uuid4

import llvmlite.binding as llvm
from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, _make_subtarget
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import (
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    RewriteSemanticConstants,
    TranslateByteCode,
)

from cable_twin.mechanics.language.specialization import PutKnown
from cable_twin.mechanics.language.target import target_context

PLAIN = types.Number, types.Boolean, types.Array  # what an operation has no other meaning for, wherever it stands
FRAME = 32  # bytes, of four SIMD lanes
MODULES = "_operator", "builtins", "math"
_found: dict[tuple[Any, ...], Any] = {}


@register_pass(mutates_CFG=True, analysis_only=False)
class FindTypes(NopythonTypeInference):
    """Numba's type inference pass, with cached types of operations on numbers and arrays."""

    _name = "find_types"

    def run_pass(self, state: Any) -> bool:
        """Run numba's type inference with the typing context that caches operations."""
        context = state.typingctx
        state.typingctx = _WithFound(context)
        try:
            return bool(super().run_pass(state))
        finally:
            state.typingctx = context


class _WithFound:
    """Numba's typing context with a cache of resolved operations."""

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, arguments: tuple[Any, ...], named: Any) -> Any:
        """Signature of an operation or call for argument types, cached for numbers and arrays; None without one."""
        meant = getattr(function, "typing_key", function)
        if named or getattr(meant, "__module__", "") not in MODULES or not all(isinstance(a, PLAIN) for a in arguments):
            return self._context.resolve_function_type(function, arguments, named)
        key = function, *arguments
        if key not in _found:
            signature = self._context.resolve_function_type(function, arguments, named)
            if signature is None:
                return None
            _found[key] = signature
        return _found[key]


PASSES = (
    TranslateByteCode,
    FixupArgs,
    IRProcessing,
    RewriteSemanticConstants,  # the length of a tuple is a constant,
    DeadBranchPrune,  # so that what is for another dimension goes
    GenericRewrites,
    PutKnown,
    ReconstructSSA,
    FindTypes,
    PreLowerStripPhis,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
)


class _Library(JITCodeLibrary):
    """Machine code of a kernel together with that of all kernels that it calls."""

    def add_ir_module(self, ir_module: Any) -> None:
        """Add the code of a kernel, whose stack frame is to begin at a multiple of the size of a SIMD register.

        By itself LLVM assumes 16 bytes: half of the registers that it puts aside are then in two lines of the cache,
        and some in two pages, which took up to a third of the time of a kernel.
        """
        for function in ir_module.functions:
            if not function.is_declaration:
                function.attributes.add("nounwind")  # llvmlite leaves out the alignment where it is the only attribute
                function.attributes.alignstack = FRAME
        super().add_ir_module(ir_module)

    def _optimize_functions(self, ll_module: Any) -> None:
        """Optimise defined functions only, without numba's preparation of mere declarations."""
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager()
                passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        """Optimise the linked module in one round, with adjacent entries of vectors and matrices vectorised (SLP).

        numba has a round before, for the counts of references that kernels do not have, and no such lanes.
        """
        passes, builder = self._codegen._module_pass_manager(slp_vectorize=True)
        passes.run(self._final_module, builder)

    def finalize(self) -> None:
        """Link the bitcode of all called kernels, each once, and generate machine code."""
        libraries = dict.fromkeys(self._linking_libraries)
        self._linking_libraries = [one for one in libraries if not isinstance(one, PartLibrary)]
        for bitcode in reversed(_parts_of(libraries)):  # callers first: what nobody calls is not taken in
            self._final_module.link_in(llvm.parse_bitcode(bitcode))
        super().finalize()


class _BriefLibrary(_Library):
    """Machine code of a kernel after numba's first round of optimisation only.

    Its parts are private: else a kernel loaded later with parts of the same names would get these less optimised ones.
    """

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.linkonce_odr:
                function.linkage = "private"
        passes, builder = self._codegen._module_pass_manager(
            opt=0, loop_vectorize=False, slp_vectorize=False, cost="cheap"
        )
        passes.run(self._final_module, builder)


class _NoCode:
    """Placeholder for numba's machine code generator in a bitcode part, which has no machine code."""

    def set_env(self, name: str, env: Any) -> None:
        """Ignore numba's environment object, as a bitcode part has no references to Python globals."""


class PartLibrary(_Library):
    """LLVM bitcode of a kernel and, separately, of all called kernels, linked into the kernel that Python calls.

    Attributes:
        parts: bitcode of each called kernel, and of this kernel as the last one.
    """

    KIND = "part"  # in what is kept of it
    codegen = _NoCode()  # type: ignore[assignment]
    parts: tuple[bytes, ...] = ()

    def finalize(self) -> None:
        """Keep the bitcode of the kernel and of the kernels that it calls, without machine code."""
        self._raise_if_finalized()
        libraries = dict.fromkeys(self._linking_libraries)
        for library in libraries:
            if not isinstance(library, PartLibrary):  # of numba itself
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"  # one of many in a kernel
        self.parts = *_parts_of(libraries), self._final_module.as_bitcode()
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Bitcode of the kernel and all kernels that it calls as one module, for a calling library of numba."""
        self._ensure_finalized()
        if self._shared_module is None:
            self._shared_module = llvm.parse_bitcode(self.parts[-1])
            for bitcode in reversed(self.parts[:-1]):
                self._shared_module.link_in(llvm.parse_bitcode(bitcode))
        return self._shared_module

    def get_pointer_to_function(self, name: str) -> int:
        """Return a null pointer, as a bitcode part has no entry point for calls."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, ...]]:
        """Serialise a bitcode part for numba's cache files."""
        self._ensure_finalized()
        return self.name, self.KIND, self.parts

    @classmethod
    def of(cls, codegen: Any, name: str, parts: tuple[bytes, ...]) -> PartLibrary:
        """Restore a bitcode part from the output of `serialize_using_object_code`."""
        library = cls(codegen, name)
        library.parts, library._finalized = parts, True
        return library


def _parts_of(libraries: Iterable[JITCodeLibrary]) -> tuple[bytes, ...]:
    """Bitcode of all parts among libraries and of the parts that these call, each once, callees first."""
    return tuple(dict.fromkeys(chain.from_iterable(one.parts for one in libraries if isinstance(one, PartLibrary))))


class WholeCompiler(CompilerBase):
    """Compiler of kernels called from Python, without passes for closures, array expressions and object mode."""

    library: type[_Library] = _Library  # that it makes

    def define_pipelines(self) -> list[PassManager]:
        """Define numba's compiler passes for a kernel, and a symbol name that is unique among processes."""
        self.state.targetctx = _make_subtarget(target_context(), self.state.flags)
        self.state.library = self.library(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        self.state.func_id.unique_id = uuid4().hex[:16]
        passes = PassManager("kernel")
        for each in PASSES:
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]


class BriefCompiler(WholeCompiler):
    """Compiler of kernels called from Python for a single short run, with little optimisation."""

    library = _BriefLibrary


class PartCompiler(WholeCompiler):
    """Compiler of kernels that only other kernels call, to bitcode without machine code."""

    library = PartLibrary
