"""Fingerprint of this process's floating-point arithmetic: rounding of numpy, of the libraries below it, and of libm.

Equal inputs give equal bits only where these libraries round alike, which depends on the CPU and on their build.
"""

from __future__ import annotations

import hashlib
import math
from functools import cache

import numpy as np

SIZES = 1, 2, 3, 4, 7, 16, 33  # of vectors, for which libraries have code of their own
OF_ARRAYS = np.exp, np.tanh, np.arcsinh, np.sin, np.cos, np.cosh, np.expm1
OF_NUMBERS = math.exp, math.sin, math.cos, math.atan, math.tanh, math.asinh, math.expm1


@cache
def arithmetic() -> str:
    """Fingerprint (8 hex digits) of the rounding of elementary functions, matrix products and linear solves."""
    results = hashlib.sha256()
    for size in SIZES:
        for start in (0.3, 1.7, 2.9):
            a = (start + 0.7310585786300049 * np.arange(1.0, size + 1.0)) % 2.718281828459045 - 1.3
            b = (start + 1.6180339887498949 * np.arange(1.0, size + 1.0)) % 3.141592653589793 + 0.1
            matrix = np.eye(size) + np.outer(b, a) / size
            arrays = [function(a) for function in OF_ARRAYS]
            arrays += [np.log(b), np.hypot(a, b), np.arctan2(a, b), b**a, b**3, np.cumsum(a), np.sqrt(b)]
            arrays += [matrix @ a, matrix @ matrix, np.linalg.solve(matrix, b), np.linalg.inv(matrix)]
            arrays += [np.array([a @ b, np.linalg.norm(a), a.sum()]), np.einsum("i,ij,j", a, matrix, b)]
            arrays += [np.array([function(number) for function in OF_NUMBERS for number in a.tolist()])]
            for array in arrays:
                results.update(np.ascontiguousarray(array, dtype=np.float64).tobytes())
    return results.hexdigest()[:8]
