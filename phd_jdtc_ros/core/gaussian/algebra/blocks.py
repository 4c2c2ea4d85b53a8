"""Compiled operations on one Gaussian, in blocks of the size of a planar state.

Results go into arrays that are passed last, so that nothing is allocated in a loop.
"""

from __future__ import annotations

import math

from ...arrays import FloatArray
from ...compilation import inner
from ...state_space import PLANAR

# A constant for the compiler, which halves the time.
SIZE = len(PLANAR)
# Smallest share of a variance that earlier axes leave unexplained; a smaller one is rounding.
LEAST_PIVOT = 1e-14


@inner
def wrapped(angle: float) -> float:
    """Return an angle wrapped to (-pi, pi]."""
    if -math.pi < angle <= math.pi:  # most are; a remainder takes ten times as long
        return angle
    turned = math.pi - (math.pi - angle) % (2.0 * math.pi)
    return turned if turned > -math.pi else math.pi


@inner
def dot(one: FloatArray, other: FloatArray) -> float:
    """Return the product of two vectors: written out, which takes two thirds of a loop's time."""
    first = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
    return float(first + one[3] * other[3] + one[4] * other[4])


@inner
def factorise(matrix: FloatArray, factor: FloatArray) -> None:
    """Write the factors of a covariance, L D L': L below the diagonal, and 1 / D on it.

    An axis without variance of its own has 0 in the place of 1 / D, so that `solve` leaves it out.
    D L' is above the diagonal.
    """
    for i in range(SIZE):
        pivot = matrix[i, i]
        for k in range(i):
            total = matrix[i, k]
            for n in range(k):
                total -= factor[n, i] * factor[k, n]
            factor[k, i] = total
            factor[i, k] = total * factor[k, k]
            pivot -= total * factor[i, k]
        factor[i, i] = 1.0 / pivot if pivot > LEAST_PIVOT * matrix[i, i] else 0.0


@inner
def solve(factor: FloatArray, vector: FloatArray) -> None:
    """Multiply a vector by the inverse of a factorised covariance, in place."""
    for i in range(SIZE):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
    for i in range(SIZE):
        vector[i] *= factor[i, i]
    for i in range(SIZE - 1, -1, -1):
        for k in range(i + 1, SIZE):
            vector[i] -= factor[k, i] * vector[k]


@inner
def square_distance(
    factor: FloatArray, one: FloatArray, other: FloatArray, apart: FloatArray
) -> float:
    """Return the square Mahalanobis distance of two vectors, by a factorised covariance."""
    square = 0.0
    for i in range(SIZE):
        apart[i] = one[i] - other[i]
        for k in range(i):
            apart[i] -= factor[i, k] * apart[k]
        square += factor[i, i] * apart[i] * apart[i]
    return square


@inner
def log_determinant(factor: FloatArray) -> float:
    """Return the log determinant of the inverse of a factorised covariance, over its axes."""
    product = 1.0
    for i in range(SIZE):
        if factor[i, i] > 0.0:
            product *= factor[i, i]
    return math.log(product)


@inner
def copy_gaussian(
    mean: FloatArray, covariance: FloatArray, to_mean: FloatArray, to_covariance: FloatArray
) -> None:
    """Copy a Gaussian; an assignment of arrays would take seconds to compile."""
    for i in range(SIZE):
        to_mean[i] = mean[i]
        for k in range(SIZE):
            to_covariance[i, k] = covariance[i, k]


@inner
def add_mean(share: float, mean: FloatArray, centre: FloatArray) -> None:
    """Add a Gaussian to the mean of a mixture."""
    for i in range(SIZE):
        centre[i] += share * mean[i]


@inner
def add_spread(
    share: float, mean: FloatArray, covariance: FloatArray, centre: FloatArray, spread: FloatArray
) -> None:
    """Add a Gaussian to the covariance of a mixture, whose mean is known."""
    for i in range(SIZE):
        apart = share * (mean[i] - centre[i])
        for k in range(SIZE):
            spread[i, k] += share * covariance[i, k] + apart * (mean[k] - centre[k])
