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
# A state in registers: a vector in an array is read again after each write into any other array.
State = tuple[float, float, float, float, float]
# Smallest share of a variance that earlier axes leave unexplained; a smaller one is rounding.
LEAST_PIVOT = 1e-14


@inner
def check_vectors(vectors: FloatArray) -> None:
    """Check the size of vectors in an array: the compiler then computes their places faster."""
    assert vectors.shape[vectors.ndim - 1] == SIZE


@inner
def check_matrices(matrices: FloatArray) -> None:
    """Check the size of square matrices in an array; see `check_vectors`."""
    assert matrices.shape[matrices.ndim - 2] == SIZE
    assert matrices.shape[matrices.ndim - 1] == SIZE


@inner
def dot(left: FloatArray | State, right: FloatArray | State) -> float:
    """Return the product of two vectors: written out, which takes two thirds of a loop's time."""
    first = left[0] * right[0] + left[1] * right[1] + left[2] * right[2]
    return float(first + left[3] * right[3] + left[4] * right[4])


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
def solve(factor: FloatArray, vector: FloatArray) -> State:
    """Return a vector, multiplied by the inverse of a factorised covariance."""
    a, b, c, d, e = vector[0], vector[1], vector[2], vector[3], vector[4]
    b -= factor[1, 0] * a
    c = c - factor[2, 0] * a - factor[2, 1] * b
    d = d - factor[3, 0] * a - factor[3, 1] * b - factor[3, 2] * c
    e = e - factor[4, 0] * a - factor[4, 1] * b - factor[4, 2] * c - factor[4, 3] * d
    e *= factor[4, 4]
    d = d * factor[3, 3] - factor[4, 3] * e
    c = c * factor[2, 2] - factor[3, 2] * d - factor[4, 2] * e
    b = b * factor[1, 1] - factor[2, 1] * c - factor[3, 1] * d - factor[4, 1] * e
    a = a * factor[0, 0] - factor[1, 0] * b - factor[2, 0] * c - factor[3, 0] * d - factor[4, 0] * e
    return a, b, c, d, e


@inner
def write(state: State, vector: FloatArray) -> None:
    """Write a state."""
    vector[0], vector[1], vector[2], vector[3], vector[4] = state


@inner
def square_distance(
    factor: FloatArray, vector: FloatArray, centre: FloatArray, whitened: FloatArray
) -> float:
    """Return the square Mahalanobis distance of two vectors, by a factorised covariance."""
    square = 0.0
    for i in range(SIZE):
        whitened[i] = vector[i] - centre[i]
        for k in range(i):
            whitened[i] -= factor[i, k] * whitened[k]
        square += factor[i, i] * whitened[i] * whitened[i]
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
def difference(left: FloatArray, right: FloatArray) -> State:
    """Return the difference of two vectors."""
    first = left[0] - right[0], left[1] - right[1], left[2] - right[2]
    return *first, left[3] - right[3], left[4] - right[4]


@inner
def times(vector: FloatArray, matrix: FloatArray) -> State:
    """Return the product of a vector and a matrix."""
    a, b, c, d, e = vector[0], vector[1], vector[2], vector[3], vector[4]
    first, second, third, fourth, last = matrix[0], matrix[1], matrix[2], matrix[3], matrix[4]
    return (
        a * first[0] + b * second[0] + c * third[0] + d * fourth[0] + e * last[0],
        a * first[1] + b * second[1] + c * third[1] + d * fourth[1] + e * last[1],
        a * first[2] + b * second[2] + c * third[2] + d * fourth[2] + e * last[2],
        a * first[3] + b * second[3] + c * third[3] + d * fourth[3] + e * last[3],
        a * first[4] + b * second[4] + c * third[4] + d * fourth[4] + e * last[4],
    )


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
    x, vx, y, vy, omega = difference(mean, centre)
    for i in range(SIZE):
        row, total, deviation = covariance[i], spread[i], share * (mean[i] - centre[i])
        # The entries of a row are all computed before any is written, so that the compiler may
        # compute several at once.
        first = total[0] + (share * row[0] + deviation * x)
        second = total[1] + (share * row[1] + deviation * vx)
        third = total[2] + (share * row[2] + deviation * y)
        fourth = total[3] + (share * row[3] + deviation * vy)
        total[4] += share * row[4] + deviation * omega
        total[0], total[1], total[2], total[3] = first, second, third, fourth
