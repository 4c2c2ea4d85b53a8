"""The systematic errors of all radars: common targets and errors are found in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, RadarBias

from ..tuning import kinematics
from .common import Target, common_targets
from .filtering import KINDS, UNITS, Course, Pass, filtered, smoothed
from .observability import Judgement, hidden_reason, judged, require_common, require_told
from .result import Found, Registration, Residuals
from .sensors import Sensor
from .sequences import Sequences, sequences

# Rounds of finding targets, and in each of linearising again.
ROUNDS, PASSES = 3, 3
# A change of all errors, in deviations, after which no other round follows.
SETTLED = 0.2
# Plots whose residuals are beyond so many deviations count less; and the least weight.
FAR, LEAST_WEIGHT = 2.5, 0.02
# The square of a two-dimensional residual of unit variances has this median.
MEDIAN_SQUARE = 2.0 * np.log(2.0)
# Of the search for the process noise: the factor of its steps, and their number at most.
FACTOR, STEPS = 4.0, 8
# Its start: how far targets leave their course between looks, in deviations of a range.
OFF_COURSE = 0.5
# Where all targets stand: m/s.
LEAST_SPEED = 0.1


@dataclass(frozen=True)
class _Round:
    """What is known after a round.

    Parameters
    ----------
    targets : sequence of Target
    biases : tuple of RadarBias
    std : array of shape (P,)
        Deviations of the errors, in `UNITS`; NaN where they are not told.
    judgement : Judgement
    density : float
    rows : Sequences
    course : Course
    """

    targets: Sequence[Target]
    biases: tuple[RadarBias, ...]
    std: FloatArray
    judgement: Judgement
    density: float
    rows: Sequences
    course: Course


def registered(sensors: Sequence[Sensor], reference: str) -> Registration:
    """Return the systematic errors of radars.

    Parameters
    ----------
    sensors : sequence of Sensor
        At least two.
    reference : str
        Name of the radar that is taken to be right where the recording does not tell.

    Raises
    ------
    RegistrationError
        If the recording tells nothing of a radar, and why.
    """
    index = [each.name for each in sensors].index(reference)
    biases: tuple[RadarBias, ...] = (NO_BIAS,) * len(sensors)
    density = _first_density(sensors)
    for number in range(ROUNDS):
        targets = common_targets(sensors, biases, known=number > 0)
        require_common(sensors, targets)
        before = biases
        found = _round(sensors, targets, biases, density, index)
        biases, density = found.biases, found.density
        if number and _change(before, found) < SETTLED:
            break
    require_told(sensors, found.judgement.free, index, found.rows)
    return _registration(sensors, found, reference)


def _round(
    sensors: Sequence[Sensor],
    targets: Sequence[Target],
    biases: Sequence[RadarBias],
    density: float,
    reference: int,
) -> _Round:
    """Return the errors of all radars, given the targets; linearised again and again."""
    rows = sequences(sensors, biases, targets)
    weight = np.ones(rows.radar.shape)
    # At first nobody knows how fast targets are; their first course says it.
    course = Course(rows.position, np.zeros_like(rows.position))
    for number in range(PASSES + 1):
        found = filtered(rows, course, density, weight, len(sensors))
        judgement = judged(found.information, _one_plot(sensors, rows, course), reference)
        errors = found.errors(judgement.free)
        course = smoothed(rows, found, errors, density)
        if number == 0:
            density = _best_density(rows, course, density, weight, len(sensors))
            continue
        biases = _followed(biases, errors)
        std = _deviations(found, errors, judgement)
        rows = sequences(sensors, biases, targets)
        weight = _weights(rows, course)
    return _Round(targets, tuple(biases), std, judgement, density, rows, course)


def _followed(biases: Sequence[RadarBias], errors: FloatArray) -> list[RadarBias]:
    """Return the errors of radars, given what is left of them in `UNITS`."""
    rest = errors.reshape(-1, len(KINDS)) * UNITS
    return [
        bias.followed_by(RadarBias(*row.tolist())) for bias, row in zip(biases, rest, strict=True)
    ]


def _weights(rows: Sequences, course: Course) -> FloatArray:
    """Return the weights of plots: those far from their target's course count less.

    Deviations are divided by the weights, so that the square of a weight c / r is what a plot with
    the residual r counts: less than by Huber's rule, by which it would be c / r.
    """
    error = _residual(rows, course) / rows.noise_std
    square = (error**2).sum(axis=-1)
    scale = np.sqrt(np.median(square[rows.there]) / MEDIAN_SQUARE)
    far = np.sqrt(square) / max(float(scale), 1e-9)
    weight: FloatArray = np.maximum(FAR / np.maximum(far, FAR), LEAST_WEIGHT)
    return weight


def _residual(rows: Sequences, course: Course) -> FloatArray:
    """Return the differences of plots to the course, shape (K, T, 2)."""
    expected, _ = kinematics.linearised(course.position, rows.pose)
    return kinematics.innovation(rows.measurement, expected)


def _deviations(found: Pass, errors: FloatArray, judgement: Judgement) -> FloatArray:
    """Return the errors' deviations in `UNITS`, NaN where they are not told, shape (P,).

    They are the larger of what the noise explains, and of what the targets' disagreement does
    (White 1980): a target that manoeuvres, or has plots of another one, is wrong as a whole.
    """
    rest = found.score - found.of_target @ errors
    spread = judgement.covariance @ (rest.T @ rest) @ judgement.covariance
    std = np.sqrt(np.maximum(np.diag(judgement.covariance), np.diag(spread)))
    return np.where(judgement.free, std, np.nan)


def _one_plot(sensors: Sequence[Sensor], rows: Sequences, course: Course) -> FloatArray:
    """Return what a plot of each radar is wrong by, as an error of each kind, in `UNITS`, (P,)."""
    found = []
    for index, each in enumerate(sensors):
        own = rows.there & (rows.radar == index)
        range_std, azimuth_std = each.noise_std
        farthest = float(rows.measurement[..., 0][own].max(initial=1.0))
        speed = max(float(np.median(np.hypot(*course.velocity[own].T))), LEAST_SPEED)
        found.append([range_std, range_std / farthest, azimuth_std, range_std / speed])
    scaled: FloatArray = np.array(found) / UNITS
    return scaled.ravel()


def _first_density(sensors: Sequence[Sensor]) -> float:
    """Return a density of the white acceleration to begin with, m^2/s^3."""
    position = min(float(each.noise_std[0]) for each in sensors)
    return 3.0 * (OFF_COURSE * position) ** 2 / max(each.look_s for each in sensors) ** 3


def _best_density(
    rows: Sequences, course: Course, start: float, weight: FloatArray, radars: int
) -> float:
    """Return the most probable density, within a factor of two."""

    def value(density: float) -> float:
        return filtered(rows, course, density, weight, radars).log_likelihood

    best, known = start, value(start)
    for factor in (FACTOR, 1.0 / FACTOR):
        for _ in range(STEPS):
            tried = value(best * factor)
            if tried <= known:
                break
            best, known = best * factor, tried
        if best != start:
            break
    return best


def _change(before: Sequence[RadarBias], found: _Round) -> float:
    """Return the largest change of an error, in its deviations."""
    change = (_numbers(found.biases) - _numbers(before)) / UNITS
    return float(np.nanmax(np.abs(change.ravel() / found.std)))


def _numbers(biases: Sequence[RadarBias]) -> FloatArray:
    """Return the errors of radars, shape (R, 4)."""
    return np.array([[getattr(bias, kind) for kind in KINDS] for bias in biases])


def _registration(sensors: Sequence[Sensor], found: _Round, reference: str) -> Registration:
    std = found.std.reshape(-1, len(KINDS)) * UNITS
    radars = []
    for index, each in enumerate(sensors):
        own = found.rows.there & (found.rows.radar == index)
        radars.append(
            Found(
                each.name,
                found.biases[index],
                std[index],
                int(np.count_nonzero(own.any(axis=0))),
                int(np.count_nonzero(own)),
                _residuals(each, found, index),
            )
        )
    hidden = {
        (sensors[error // len(KINDS)].name, KINDS[error % len(KINDS)]): hidden_reason(
            sensors, found.rows
        )
        for error in sorted(found.judgement.hidden)
    }
    return Registration(
        tuple(radars),
        reference,
        found.judgement.common,
        hidden,
        len(found.targets),
        found.density,
    )


def _residuals(sensor: Sensor, found: _Round, index: int) -> Residuals:
    """Return the differences of a radar's plots to the targets, as reported and corrected."""
    rows, own = found.rows, found.rows.there & (found.rows.radar == index)
    plot, pose = rows.plot[own], rows.pose[own]
    late_s = found.biases[index].time_offset_s
    position, velocity = found.course.position[own], found.course.velocity[own]
    then, _ = kinematics.linearised(position + late_s * velocity, pose)
    return Residuals(
        rows.time_s[own],
        kinematics.innovation(sensor.measurement[plot], then),
        _residual(rows, found.course)[own],
    )
