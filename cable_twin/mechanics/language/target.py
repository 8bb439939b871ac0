"""Target of compilation: one class of CPUs, for which kernels are the same code on every CPU that has it.

A log made on one CPU of a class then replays to the last bit on another one, and kernels that are compiled once serve
all of them. The instructions of newer CPUs are left to `CABLE_TWIN_CPU=native`.
"""

from __future__ import annotations

import functools
import logging
import os
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding as llvm
from numba.core import config as numba_config
from numba.core.codegen import JITCPUCodegen, get_host_cpu_features
from numba.core.registry import cpu_target

VARIABLE, NATIVE = "CABLE_TWIN_CPU", "native"
config: Any = numba_config


class Target(NamedTuple):
    """CPU or class of CPUs that kernels are compiled for."""

    name: str
    cpu: str  # name that LLVM has for it
    features: str  # as LLVM reads them: +NAME or -NAME, by commas


def _class(name: str, cpu: str, features: str) -> Target:
    return Target(name, cpu, ",".join(f"+{feature}" for feature in features.split()))


CLASSES = {  # of machines, by the first word of LLVM's triple
    "x86_64": _class(  # level 3 of the System V ABI: Haswell (2013), Zen (2017) and all later ones of theirs
        "x86-64-v3",
        "x86-64-v3",
        "64bit cmov cx8 fxsr mmx sse sse2 cx16 popcnt sahf sse3 sse4.1 sse4.2 ssse3 crc32 "
        "avx avx2 bmi bmi2 f16c fma lzcnt movbe xsave",
    ),
    "aarch64": _class("armv8-a", "generic", "fp-armv8 neon"),  # all 64-bit ARM
}
CLASSES["arm64"] = CLASSES["aarch64"]  # as macOS calls it


def host() -> Target:
    """CPU of this machine, as numba takes it, with NUMBA_CPU_NAME and NUMBA_CPU_FEATURES."""
    name = config.CPU_NAME or llvm.get_host_cpu_name()
    features = get_host_cpu_features() if config.CPU_FEATURES is None else config.CPU_FEATURES
    return Target(name, name, features)


def choose(wanted: str, machine: str, host: Target) -> Target:
    """Target for a machine.

    Args:
        wanted: empty for the class of its CPU where it has one, `native` for that CPU itself, or the name of the class.
        machine: kind, as `x86_64`.
        host: its CPU.

    Raises:
        ValueError: there is no such target here; in one line.
    """
    known = CLASSES.get(machine)
    if known is not None and not set(known.features.split(",")) <= set(host.features.split(",")):
        known = None
    if wanted and wanted not in (NATIVE, *([known.name] if known else [])):
        allowed = f"{known.name} or {NATIVE}" if known else f"{NATIVE}, as this CPU ({host.name}) is of no known class"
        raise ValueError(f"{VARIABLE}: given {wanted!r}; allowed: {allowed}")
    return host if known is None or wanted == NATIVE else known


@functools.cache
def target() -> Target:
    """Target of this process; where the variable names none that there is, the default one, and a line says so."""
    machine = llvm.get_process_triple().partition("-")[0]
    try:
        return choose(os.environ.get(VARIABLE, "").strip(), machine, host())
    except ValueError as error:
        default = choose("", machine, host())
        logging.getLogger("cable_twin").warning("%s; %s is taken", error, default.name)
        return default


class _Codegen(JITCPUCodegen):
    """Code generator of numba for the target; that of other code in the process remains as it is."""

    def _get_host_cpu_name(self) -> str:
        return target().cpu

    def _get_host_cpu_features(self) -> str:
        return target().features

    def magic_tuple(self) -> tuple[Any, ...]:
        """Text under which compiled code is kept: the target, and what else code of the same sources depends on."""
        return *super().magic_tuple(), llvmlite.__version__, bool(config.USING_SVML)


@functools.cache
def target_context() -> Any:
    """Context in which numba compiles and loads kernels."""
    context: Any = cpu_target.target_context
    return context.subtarget(_internal_codegen=_Codegen("cable_twin"))
