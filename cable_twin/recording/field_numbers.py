"""Numbers at known places in message bytes, read without decoding the rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cable_twin.frame.records import FloatArray


def last_numbers(data: bytes, count: int) -> FloatArray:
    """Doubles at the end of a message."""
    return np.frombuffer(data, "<f8", count, len(data) - 8 * count)


def reader(count: int, targets: Sequence[FloatArray]) -> Callable[[bytes], None]:
    """Reader of a message that ends with `count` doubles, the first of which are copied to the targets."""
    sizes = [target.size for target in targets]

    def read(data: bytes) -> None:
        numbers, taken = last_numbers(data, count), 0
        for target, size in zip(targets, sizes, strict=True):
            target[:] = numbers[taken : taken + size]
            taken += size

    return read


def joint_reader(rates: FloatArray, efforts: FloatArray) -> Callable[[bytes], None]:
    """Reader of rates and efforts (n,) of a JointState, which ends with three arrays of n, 8 bytes apart."""
    count = rates.size

    def read(data: bytes) -> None:
        numbers = last_numbers(data, 2 * count + 1)
        rates[:], efforts[:] = numbers[:count], numbers[count + 1 :]

    return read


def table_reader(targets: Sequence[FloatArray]) -> Callable[[bytes], None]:
    """Reader of a message that ends with a row of doubles for each row of the targets."""
    rows, width = len(targets[0]), sum(target.shape[1] for target in targets)
    return lambda data: fill(last_numbers(data, rows * width).reshape(rows, width), targets)


def fill(table: FloatArray, targets: Sequence[FloatArray]) -> None:
    """Spread the columns of a table (rows, width) over the targets (rows, ...)."""
    taken = 0
    for target in targets:
        target[:] = table[:, taken : taken + target.shape[1]]
        taken += target.shape[1]


def cloud_points(data: bytes, count: int, fields: Sequence[str]) -> FloatArray:
    """Points (count, fields) of a PointCloud2 of float32, from the bytes before the last one."""
    size = 4 * len(fields)
    return np.frombuffer(data, "<f4", count * len(fields), len(data) - 1 - count * size).reshape(count, -1)


__all__ = ["cloud_points", "fill", "joint_reader", "last_numbers", "reader", "table_reader"]
