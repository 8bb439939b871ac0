"""Compilation target: an instruction-set class of CPUs, for which kernels are the same code on every CPU that has it.

A log made on one CPU of a class then replays to the last bit on another one, and kernels that are compiled once serve
all of them. The instructions of newer CPUs are left to `CABLE_TWIN_CPU=native`.
"""

from __future__ import annotations

import functools
from typing import Any

import llvmlite
import llvmlite.binding as llvm
from numba.core import config as numba_config
from numba.core.codegen import JITCPUCodegen, get_host_cpu_features
from numba.core.registry import cpu_target

from cable_twin.basics.cpu import Target, chosen

config: Any = numba_config


@functools.cache
def target() -> Target:
    """Compilation target of this process, from the CPU of this machine or NUMBA_CPU_NAME and NUMBA_CPU_FEATURES."""
    name = config.CPU_NAME or llvm.get_host_cpu_name()
    features = get_host_cpu_features() if config.CPU_FEATURES is None else config.CPU_FEATURES
    return chosen(Target(name, name, features))


class _Codegen(JITCPUCodegen):
    """Numba's code generator for the compilation target; that of other code in the process remains as it is."""

    def _get_host_cpu_name(self) -> str:
        return target().cpu

    def _get_host_cpu_features(self) -> str:
        return target().features

    def magic_tuple(self) -> tuple[Any, ...]:
        """Cache key of compiled code: the compilation target, and what else code of the same sources depends on."""
        return *super().magic_tuple(), llvmlite.__version__, bool(config.USING_SVML)


@functools.cache
def target_context() -> Any:
    """Numba's target context, in which kernels are compiled and loaded for the compilation target."""
    context: Any = cpu_target.target_context
    return context.subtarget(_internal_codegen=_Codegen("cable_twin"))
