"""Compiled operations on one Gaussian, and at the end on vectors of any size.

Results go into arrays that are passed last, so that nothing is allocated in a loop. The compiler
leaves out what is only for states in space where `SIZE` is that of the plane.
"""

from __future__ import annotations

import math

from ...arrays import FloatArray
from ...compilation import SIZE, inner
from ...state_space import VZ, Z

# A state in registers: a vector in an array is read again after each write into any other array. In
# the plane the last two are 0.
State = tuple[float, float, float, float, float, float, float]
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
    first = first + left[3] * right[3] + left[4] * right[4]
    if SIZE > Z:
        first = first + left[Z] * right[Z] + left[VZ] * right[VZ]
    return float(first)


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
    a, b, c, d, e, f, g = read(vector)
    b -= factor[1, 0] * a
    c = c - factor[2, 0] * a - factor[2, 1] * b
    d = d - factor[3, 0] * a - factor[3, 1] * b - factor[3, 2] * c
    e = e - factor[4, 0] * a - factor[4, 1] * b - factor[4, 2] * c - factor[4, 3] * d
    if SIZE > Z:
        f = f - factor[5, 0] * a - factor[5, 1] * b - factor[5, 2] * c - factor[5, 3] * d
        f -= factor[5, 4] * e
        g = g - factor[6, 0] * a - factor[6, 1] * b - factor[6, 2] * c - factor[6, 3] * d
        g = g - factor[6, 4] * e - factor[6, 5] * f
    a, b, c = a * factor[0, 0], b * factor[1, 1], c * factor[2, 2]
    d, e = d * factor[3, 3], e * factor[4, 4]
    if SIZE > Z:
        g *= factor[6, 6]
        f = f * factor[5, 5] - factor[6, 5] * g
        e = e - factor[5, 4] * f - factor[6, 4] * g
        d = d - factor[5, 3] * f - factor[6, 3] * g
        c = c - factor[5, 2] * f - factor[6, 2] * g
        b = b - factor[5, 1] * f - factor[6, 1] * g
        a = a - factor[5, 0] * f - factor[6, 0] * g
    d -= factor[4, 3] * e
    c = c - factor[3, 2] * d - factor[4, 2] * e
    b = b - factor[2, 1] * c - factor[3, 1] * d - factor[4, 1] * e
    a = a - factor[1, 0] * b - factor[2, 0] * c - factor[3, 0] * d - factor[4, 0] * e
    return a, b, c, d, e, f, g


@inner
def read(vector: FloatArray | State) -> State:
    """Return a vector in registers; in the plane height and climb rate are 0."""
    planar = vector[0], vector[1], vector[2], vector[3], vector[4]
    if SIZE > Z:
        return *planar, vector[Z], vector[VZ]
    return *planar, 0.0, 0.0


@inner
def write(state: State, vector: FloatArray) -> None:
    """Write a state into a vector; in the plane without height and climb rate."""
    vector[0], vector[1], vector[2], vector[3], vector[4] = state[:5]
    if SIZE > Z:
        vector[Z], vector[VZ] = state[Z], state[VZ]


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
def divergence(covariance: FloatArray, factor: FloatArray, own_factor: FloatArray) -> float:
    """Return twice the Kullback-Leibler divergence of a Gaussian from one of the same mean.

    `factor` is that of the other's covariance, whose axes without variance are left out, and
    `own_factor` is written. With other means the `square_distance` is added.
    """
    twice = 0.0
    factorise(covariance, own_factor)
    for i in range(SIZE):
        if factor[i, i] > 0.0 and own_factor[i, i] > 0.0:
            twice += solve(factor, covariance[i])[i] - 1.0
            twice += math.log(own_factor[i, i] / factor[i, i])
    return twice


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
    a, b, c, d, e, f, g = read(left)
    p, q, r, s, t, u, v = read(right)
    return a - p, b - q, c - r, d - s, e - t, f - u, g - v


@inner
def times(vector: FloatArray, matrix: FloatArray) -> State:
    """Return the product of a vector and a matrix."""
    a, b, c, d, e, f, g = read(vector)
    p, q, r, s, t = matrix[0], matrix[1], matrix[2], matrix[3], matrix[4]
    planar = (
        a * p[0] + b * q[0] + c * r[0] + d * s[0] + e * t[0],
        a * p[1] + b * q[1] + c * r[1] + d * s[1] + e * t[1],
        a * p[2] + b * q[2] + c * r[2] + d * s[2] + e * t[2],
        a * p[3] + b * q[3] + c * r[3] + d * s[3] + e * t[3],
        a * p[4] + b * q[4] + c * r[4] + d * s[4] + e * t[4],
    )
    if SIZE > Z:
        u, v = matrix[Z], matrix[VZ]
        return (
            planar[0] + f * u[0] + g * v[0],
            planar[1] + f * u[1] + g * v[1],
            planar[2] + f * u[2] + g * v[2],
            planar[3] + f * u[3] + g * v[3],
            planar[4] + f * u[4] + g * v[4],
            a * p[Z] + b * q[Z] + c * r[Z] + d * s[Z] + e * t[Z] + f * u[Z] + g * v[Z],
            a * p[VZ] + b * q[VZ] + c * r[VZ] + d * s[VZ] + e * t[VZ] + f * u[VZ] + g * v[VZ],
        )
    return *planar, 0.0, 0.0


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
    x, vx, y, vy, omega, z, vz = difference(mean, centre)
    for i in range(SIZE):
        row, total, deviation = covariance[i], spread[i], share * (mean[i] - centre[i])
        # The entries of a row are all computed before any is written, so that the compiler may
        # compute several at once.
        first = total[0] + (share * row[0] + deviation * x)
        second = total[1] + (share * row[1] + deviation * vx)
        third = total[2] + (share * row[2] + deviation * y)
        fourth = total[3] + (share * row[3] + deviation * vy)
        fifth = total[4] + (share * row[4] + deviation * omega)
        if SIZE > Z:
            total[Z] += share * row[Z] + deviation * z
            total[VZ] += share * row[VZ] + deviation * vz
        total[0], total[1], total[2], total[3], total[4] = first, second, third, fourth, fifth


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
