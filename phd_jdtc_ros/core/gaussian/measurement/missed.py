"""Gaussians of targets that were missed at a limit of the coverage: they are probably outside."""

from __future__ import annotations

import math

import numpy as np

from ...arrays import FloatArray, IntArray
from ...compilation import Float1, Float2, Float3, Int1, compiled, inner
from ...sensors.of_gaussians.linearised import Expected
from ...sensors.sensor import Sensor
from ..mixture import Hypotheses, Mixture

# Gaussians with a smaller part within the limits, or beyond them, keep their moments.
LEAST_PART = 1e-3
# Limits farther away on both sides, in standard deviations, cut off less than `LEAST_PART`.
FAR_SIGMA = 3.3


@compiled
def missed_and_measured(
    mixture: Hypotheses, detection_probability: Float3, measured: Float3
) -> tuple[FloatArray, FloatArray]:
    """Return the weight of each target's missed detection, (T,), and a measurement of it, (T, Z).

    The measurement is that of the most probable mode of the target's first hypothesis.
    `detection_probability`, (H, R, C), and `measured`, (H, R, Z), are those of each Gaussian.
    """
    target, mode_weight, weight = mixture.target, mixture.mode_weight, mixture.weight
    targets = len(mixture.label)
    missed, measured_by_target = np.zeros(targets), np.zeros((targets, measured.shape[2]))
    found = np.zeros(targets, np.bool_)
    for row in range(len(target)):
        index, best = target[row], 0
        for mode in range(weight.shape[1]):
            if mode_weight[row, mode] > mode_weight[row, best]:
                best = mode
            for class_id in range(weight.shape[2]):
                probability = 1.0 - detection_probability[row, mode, class_id]
                missed[index] += weight[row, mode, class_id] * probability
        if not found[index]:
            found[index] = True
            for axis in range(measured.shape[2]):
                measured_by_target[index, axis] = measured[row, best, axis]
    return missed, measured_by_target


@inner
def _moments_within(limits: FloatArray, mean: float, std: float) -> tuple[float, float, float]:
    """Return integrals of a normal density over the intervals of `limits`, (I, 2).

    They are of 1, of the deviation from the mean, and of its square, in standard deviations; 0
    without a limit nearby.
    """
    mass, first, second, is_near = 0.0, 0.0, 0.0, False
    for limit in limits.flat:
        is_near = is_near or abs(limit - mean) < FAR_SIGMA * std
    for index in range(limits.size if is_near else 0):
        sign, edge = 2.0 * (index % 2) - 1.0, (limits[index // 2, index % 2] - mean) / std
        density = sign * math.exp(-0.5 * edge * edge) / math.sqrt(2.0 * math.pi)
        below = sign * 0.5 * math.erfc(-edge / math.sqrt(2.0))
        mass, first, second = mass + below, first - density, second + below
        if math.isfinite(edge):
            second -= edge * density
    return mass, first, second


@compiled
def _divided(
    component: Int1, limits: Float2, weight: Float1, measured: Float2, std: Float2
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return which of N Gaussians limits divide, the divided component of each, and moments.

    For the first arguments see `FieldOfView.limits`. The moments within them, (3, K), are those of
    `_moments_within`.
    """
    count, (rows, axes) = 0, np.empty((2, len(weight)), np.int64)
    moments = np.empty((3, len(weight)))
    for row in range(len(weight)):
        smaller_part, end = LEAST_PART, 0
        while end < len(component) and weight[row] > 0.0:
            begin, axis = end, component[end]
            while end < len(component) and component[end] == axis:
                end += 1
            inside = limits[begin:end]
            mass, first, second = _moments_within(inside, measured[row, axis], std[row, axis])
            if min(mass, 1.0 - mass) > smaller_part:
                smaller_part = min(mass, 1.0 - mass)
                rows[count], axes[count] = row, axis
                moments[0, count], moments[1, count], moments[2, count] = mass, first, second
        count += smaller_part > LEAST_PART
    return rows[:count], axes[:count], moments[:, :count]


def after_miss(
    mixture: Mixture, expected: Expected, sensor: Sensor, detection_probability: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return the means and covariances after a miss, (H, R, D) and (H, R, D, D).

    Parameters
    ----------
    detection_probability : array of shape (H, R, C)
        Probability that each Gaussian is detected.

    Returns
    -------
    tuple or None
        None if no Gaussian is at a limit of the sensor's coverage.

    Notes
    -----
    With the part A of a component d of the measurement within its limits, and the detection
    probability p there, the density of d after a miss is proportional to N(d; m, s^2) (1 - p
    1[d within]). Its mean and variance are matched; the other axes follow by their regression on
    d. A Gaussian at limits of both components is changed along the one that divides it more evenly.
    """
    size, components = mixture.sums.mode_weight.size, expected.measured.shape[-1]
    measured = expected.measured.reshape(-1, components)
    std, weight = expected.std.reshape(-1, components), mixture.sums.mode_weight.ravel()
    rows, axis, moments = _divided(*sensor.visibility.limits, weight, measured, std)
    if not len(rows) or not (usable := sensor.of_gaussians.is_nearly_normal(std[rows])).any():
        return None
    rows, axis, (mass_inside, first, second) = rows[usable], axis[usable], moments[:, usable]
    weight, detection_probability = (
        part.reshape(size, -1)[rows] for part in (mixture.weight, detection_probability)
    )
    detected = np.average(detection_probability, axis=1, weights=weight)
    probability = np.minimum(detected / mass_inside, 1.0)
    missed = 1.0 - probability * mass_inside
    shift = -probability * first / missed
    variance_change = (1.0 - probability * second) / missed - shift**2 - 1.0

    position, axes = list(sensor.space.place), mixture.mean.shape[-1]
    mean = mixture.mean.reshape(size, axes).copy()
    covariance = mixture.covariance.reshape(size, axes, axes).copy()
    gradient = sensor.linearise(mean[rows][:, position])[1][np.arange(len(rows)), axis]
    slope = np.einsum("nip,np->ni", covariance[rows][:, :, position], gradient)
    slope /= std[rows, axis, None]
    mean[rows] += shift[:, None] * slope
    covariance[rows] += variance_change[:, None, None] * slope[:, :, None] * slope[:, None, :]
    return mean.reshape(mixture.mean.shape), covariance.reshape(mixture.covariance.shape)
