"""Instruction-set classes of CPUs (as x86-64-v3): every CPU of a class gives bit-equal results.

Kernels are compiled for a class (`mechanics/language/target`). numpy, and BLAS and LAPACK below it, choose their code
by the CPU at hand and round differently with AVX-512; a command limits them to the class.
"""

from __future__ import annotations

import logging
import os
from functools import cache
from typing import NamedTuple

import llvmlite.binding as llvm

VARIABLE, NATIVE = "CABLE_TWIN_CPU", "native"


class Target(NamedTuple):
    """Compilation target of kernels: a CPU, or an instruction-set class of CPUs."""

    name: str
    cpu: str  # name that LLVM has for it
    features: str  # as LLVM reads them: +NAME or -NAME, by commas


class CpuClass(NamedTuple):
    """Instruction-set class of CPUs, with the environment values that limit numpy and OpenBLAS to the class."""

    target: Target
    beyond: str  # features that numpy uses where it finds them
    core: str  # that OpenBLAS takes the CPU for


def _class(name: str, cpu: str, features: str, beyond: str, core: str) -> CpuClass:
    return CpuClass(Target(name, cpu, ",".join(f"+{feature}" for feature in features.split())), beyond, core)


CLASSES = {  # of machines, by the first word of LLVM's triple
    "x86_64": _class(  # level 3 of the System V ABI: Haswell (2013), Zen (2017) and all later ones of theirs
        "x86-64-v3",
        "x86-64-v3",
        "64bit cmov cx8 fxsr mmx sse sse2 cx16 popcnt sahf sse3 sse4.1 sse4.2 ssse3 crc32 "
        "avx avx2 bmi bmi2 f16c fma lzcnt movbe xsave",
        "X86_V4 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR",
        "Haswell",
    ),
    "aarch64": _class("armv8-a", "generic", "fp-armv8 neon", "ASIMDHP ASIMDDP ASIMDFHM SVE", "ARMV8"),  # 64-bit ARM
}
CLASSES["arm64"] = CLASSES["aarch64"]  # as macOS calls it


def machine() -> str:
    """Architecture of this machine, as `x86_64`."""
    return str(llvm.get_process_triple().partition("-")[0])


def this_cpu() -> Target:
    """Compilation target for exactly the CPU of this machine."""
    name = llvm.get_host_cpu_name()
    return Target(name, name, llvm.get_host_cpu_features().flatten())


def class_of(kind: str, host: Target) -> CpuClass | None:
    """Instruction-set class (as x86-64-v3) of a CPU, by machine architecture; None for a CPU of no known class."""
    known = CLASSES.get(kind)
    has = known is not None and set(known.target.features.split(",")) <= set(host.features.split(","))
    return known if has else None


def choose(wanted: str, kind: str, host: Target) -> Target:
    """Choose the compilation target of kernels for a machine: its CPU's instruction-set class, or the CPU itself.

    Args:
        wanted: empty for the class of its CPU where it has one, `native` for that CPU itself, or the name of the class.
        kind: architecture of the machine, as `x86_64`.
        host: CPU of the machine.

    Raises:
        ValueError: this CPU has no such target; the message is one line.
    """
    known = class_of(kind, host)
    if wanted and wanted not in (NATIVE, *([known.target.name] if known else [])):
        allowed = f"{known.target.name} or {NATIVE}" if known else f"{NATIVE}, as {host.name} is of no known class"
        raise ValueError(f"{VARIABLE}: given {wanted!r}; allowed: {allowed}")
    return host if known is None or wanted == NATIVE else known.target


@cache
def chosen(host: Target) -> Target:
    """Compilation target named by the environment variable CABLE_TWIN_CPU; if unknown, the default, with a warning."""
    try:
        return choose(os.environ.get(VARIABLE, "").strip(), machine(), host)
    except ValueError as error:
        default = choose("", machine(), host)
        logging.getLogger("cable_twin").warning("%s; %s is used", error, default.name)
        return default


def hold_numpy_to_the_class() -> None:
    """Limit numpy and OpenBLAS to this CPU's instruction-set class, for a command, before either is imported.

    The limits are environment variables, which child processes inherit; values that the user has set are kept.
    """
    known = class_of(machine(), this_cpu())
    if known is None or os.environ.get(VARIABLE, "").strip() == NATIVE:
        return
    os.environ.setdefault("OPENBLAS_CORETYPE", known.core)
    if "NPY_ENABLE_CPU_FEATURES" not in os.environ:
        os.environ.setdefault("NPY_DISABLE_CPU_FEATURES", known.beyond)
