"""Compiled operations on vectors of any size, in loops that allocate nothing."""

from __future__ import annotations

from ...arrays import FloatArray
from ...compilation import inner


@inner
def total_of(vector: FloatArray) -> float:
    """Return the sum of a vector, entry by entry."""
    total = 0.0
    for i in range(len(vector)):
        total += vector[i]
    return total


@inner
def add(vector: FloatArray, total: FloatArray) -> None:
    """Add a vector to another one."""
    for i in range(len(vector)):
        total[i] += vector[i]


@inner
def product(left: FloatArray, right: FloatArray) -> float:
    """Return the product of two vectors."""
    total = 0.0
    for i in range(len(left)):
        total += left[i] * right[i]
    return total


@inner
def sum_of(matrix: FloatArray) -> float:
    """Return the sum of a matrix, row by row."""
    total = 0.0
    for i in range(len(matrix)):
        total += total_of(matrix[i])
    return total
