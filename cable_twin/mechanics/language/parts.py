"""How numba compiles a kernel that only kernels call: to bitcode, which becomes machine code within its callers alone.

numba would optimise each kernel, and translate it, anew in every caller and in that one's callers, up to the one that
Python calls. Here this is done once, in that one: half of the time that LLVM takes in a first start. The machine code
is the same, as LLVM sees the same. The passes of numba that kernels have no use for are left out as well.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, compile_result
from numba.core.compiler_machinery import PassManager
from numba.core.registry import cpu_target
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
    InlineInlinables,
    IRProcessing,
    ReconstructSSA,
    RewriteSemanticConstants,
    TranslateByteCode,
)

from cable_twin.mechanics.language.content import content_of
from cable_twin.mechanics.language.known import PutKnown

PASSES = (
    TranslateByteCode,
    FixupArgs,
    IRProcessing,
    RewriteSemanticConstants,  # the length of a tuple is a constant,
    DeadBranchPrune,  # so that what is for another dimension goes
    GenericRewrites,
    InlineInlinables,
    PutKnown,
    ReconstructSSA,
    NopythonTypeInference,
    PreLowerStripPhis,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
)


class WholeCompiler(CompilerBase):
    """Compiles what Python calls: numba's passes without those for closures, array expressions and object mode."""

    def define_pipelines(self) -> list[PassManager]:
        """As numba asks for them; a name with the content in it is that of no other function, in any process."""
        self.state.func_id.unique_id = content_of(self.state.func_id.func)
        passes = PassManager("kernel")
        for each in PASSES:
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]


class BriefCompiler(WholeCompiler):
    """Compiles what Python calls, and what does not run for long."""

    def define_pipelines(self) -> list[PassManager]:
        """As numba asks for them."""
        self.state.library = _BriefLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


class PartCompiler(WholeCompiler):
    """Compiles what kernels call."""

    def define_pipelines(self) -> list[PassManager]:
        """As numba asks for them."""
        self.state.library = _PartLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


class _BriefLibrary(JITCodeLibrary):
    """A kernel in whose optimisation numba's first round is the only one."""

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager(
            opt=0, loop_vectorize=False, slp_vectorize=False, cost="cheap"
        )
        passes.run(self._final_module, builder)


class _NoCode:
    """In place of the generator of a part's machine code, of which there is none."""

    def set_env(self, name: str, env: Any) -> None:
        """Nothing refers to it."""


class _PartLibrary(JITCodeLibrary):
    """Bitcode of a kernel and of all that it calls."""

    codegen = _NoCode()  # type: ignore[assignment]

    def _optimize_final_module(self) -> None:
        """Leave it to the library of the last caller."""

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Null: it is called by nobody."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """As numba keeps it in a file."""
        self._ensure_finalized()
        return self.name, "part", self._get_module_for_linking().as_bitcode()

    @classmethod
    def of(cls, codegen: Any, name: str, bitcode: bytes) -> _PartLibrary:
        """Make one of what `serialize_using_object_code` gave."""
        library = cls(codegen, name)
        library._final_module = library._shared_module = llvm.parse_bitcode(bitcode)
        library._finalized = True
        return library


class _PartFile(CompileResultCacheImpl):
    """A part as numba keeps it."""

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Make of it what compiling it gave."""
        (name, _, bitcode), function, env, signature, *_ = payload
        library = _PartLibrary.of(target_context.codegen(), name, bitcode)
        return compile_result(
            typing_context=target_context.typing_context,
            target_context=target_context,
            library=library,
            environment=env,
            entry_point=target_context.get_executable(library, function, env),
            fndesc=function,
            signature=signature,
            objectmode=False,
            reload_init=[],
        )


class KernelCache(FunctionCache):
    """Where numba keeps what Python calls, found by its content."""

    def has(self, types: tuple[Any, ...]) -> bool:
        """Whether it is there for arguments of these types."""
        return self._index_key(types, cpu_target.target_context.codegen()) in self._cache_file._load_index()

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), content_of(self._py_func))


class PartCache(KernelCache):
    """Where numba keeps parts."""

    _impl_class = _PartFile  # type: ignore[assignment]


__all__ = ["BriefCompiler", "KernelCache", "PartCache", "PartCompiler", "WholeCompiler"]
