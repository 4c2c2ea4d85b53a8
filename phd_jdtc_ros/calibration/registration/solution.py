"""Estimates the biases of all radars, alternating between common targets and biases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, RadarBias

from ..tuning import kinematics
from .common import Target, common_targets
from .filtering import KINDS, UNITS, Course, Pass, filter_sequences, smooth_trajectories
from .observability import Judgement, hidden_reason, judge, require_common, require_observable
from .result import Found, Registration, Residuals
from .sensors import Sensor
from .sequences import Sequences, sequences

# Rounds of finding common targets, and of linearisations in each.
ROUNDS, PASSES = 3, 3
# The rounds end when no bias changes by more than this many standard deviations.
SETTLED = 0.2
# Plots with larger residuals, in standard deviations, have less weight, but at least LEAST_WEIGHT.
FAR, LEAST_WEIGHT = 2.5, 0.02
# Median of the square of a two-dimensional residual of unit variances.
MEDIAN_SQUARE = 2.0 * np.log(2.0)
# Search for the process noise: factor of a step, and largest number of steps.
FACTOR, STEPS = 4.0, 8
# Its start: deviation of targets from a straight line between scans, in standard deviations of a
# range.
OFF_COURSE = 0.5
# Speed that is assumed if all targets are stationary, m/s.
LEAST_SPEED = 0.1


@dataclass(frozen=True)
class _Round:
    """The state after a round.

    Parameters
    ----------
    std : array of shape (P,)
        Standard deviations of the biases, in `UNITS`; NaN if unobservable.
    """

    targets: Sequence[Target]
    biases: tuple[RadarBias, ...]
    std: FloatArray
    judgement: Judgement
    density: float
    rows: Sequences
    course: Course


def register(sensors: Sequence[Sensor], reference: str) -> Registration:
    """Return the biases of radars.

    Parameters
    ----------
    sensors : sequence of Sensor
        At least two.
    reference : str
        Name of the radar that is assumed to have no bias where the recording cannot show it.

    Raises
    ------
    RegistrationError
        If no bias of some radar is observable; the message has the reason.
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
    require_observable(sensors, found.judgement.free, index, found.rows)
    return _registration(sensors, found, reference)


def _round(
    sensors: Sequence[Sensor],
    targets: Sequence[Target],
    biases: Sequence[RadarBias],
    density: float,
    reference: int,
) -> _Round:
    """Return the biases of all radars, given the targets, by repeated linearisation."""
    rows = sequences(sensors, biases, targets)
    weight = np.ones(rows.radar.shape)
    # The velocities are unknown until the first pass.
    course = Course(rows.position, np.zeros_like(rows.position))
    for number in range(PASSES + 1):
        found = filter_sequences(rows, course, density, weight, len(sensors))
        judgement = judge(found.information, _one_plot(sensors, rows, course), reference)
        errors = found.errors(judgement.free)
        course = smooth_trajectories(rows, found, errors, density)
        if number == 0:
            density = _best_density(rows, course, density, weight, len(sensors))
            continue
        biases = _follow(biases, errors)
        std = _deviations(found, errors, judgement)
        rows = sequences(sensors, biases, targets)
        weight = _weights(rows, course)
    return _Round(targets, tuple(biases), std, judgement, density, rows, course)


def _follow(biases: Sequence[RadarBias], errors: FloatArray) -> list[RadarBias]:
    """Return the biases after a correction in `UNITS`."""
    rest = errors.reshape(-1, len(KINDS)) * UNITS
    return [
        bias.followed_by(RadarBias(*row.tolist())) for bias, row in zip(biases, rest, strict=True)
    ]


def _weights(rows: Sequences, course: Course) -> FloatArray:
    """Return the weights of plots; those far from their target's trajectory have less weight.

    The weights divide the standard deviations. A plot with residual r has the weight c / r and
    therefore counts (c / r)^2, less than by Huber's rule, by which it would count c / r.
    """
    error = _residual(rows, course) / rows.noise_std
    square = (error**2).sum(axis=-1)
    scale = np.sqrt(np.median(square[rows.there]) / MEDIAN_SQUARE)
    far = np.sqrt(square) / max(float(scale), 1e-9)
    weight: FloatArray = np.maximum(FAR / np.maximum(far, FAR), LEAST_WEIGHT)
    return weight


def _residual(rows: Sequences, course: Course) -> FloatArray:
    """Return the residuals of plots against the trajectories, shape (K, T, 2)."""
    expected, _ = kinematics.linearise(course.position, rows.pose)
    return kinematics.innovation(rows.measurement, expected)


def _deviations(found: Pass, errors: FloatArray, judgement: Judgement) -> FloatArray:
    """Return the standard deviations of the biases in `UNITS`, NaN if unobservable, shape (P,).

    Each is the larger of two: that from the noise, and that from the disagreement of the targets
    (White 1980), because a target that manoeuvres or has plots of another one is wrong as a whole.
    """
    rest = found.score - found.of_target @ errors
    spread = judgement.covariance @ (rest.T @ rest) @ judgement.covariance
    std = np.sqrt(np.maximum(np.diag(judgement.covariance), np.diag(spread)))
    return np.where(judgement.free, std, np.nan)


def _one_plot(sensors: Sequence[Sensor], rows: Sequences, course: Course) -> FloatArray:
    """Return the noise of one plot of each radar as a bias of each kind, in `UNITS`, (P,)."""
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
    """Return an initial spectral density of the white acceleration, m^2/s^3."""
    position = min(float(each.noise_std[0]) for each in sensors)
    return 3.0 * (OFF_COURSE * position) ** 2 / max(each.look_s for each in sensors) ** 3


def _best_density(
    rows: Sequences, course: Course, start: float, weight: FloatArray, radars: int
) -> float:
    """Return the most probable spectral density, within a factor of two."""

    def value(density: float) -> float:
        return filter_sequences(rows, course, density, weight, radars).log_likelihood

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
    """Return the largest change of a bias, in its standard deviations."""
    change = (_numbers(found.biases) - _numbers(before)) / UNITS
    return float(np.nanmax(np.abs(change.ravel() / found.std)))


def _numbers(biases: Sequence[RadarBias]) -> FloatArray:
    """Return the biases of radars, shape (R, 4)."""
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
    """Return the residuals of a radar's plots, as reported and corrected."""
    rows, own = found.rows, found.rows.there & (found.rows.radar == index)
    plot, pose = rows.plot[own], rows.pose[own]
    late_s = found.biases[index].time_offset_s
    position, velocity = found.course.position[own], found.course.velocity[own]
    then, _ = kinematics.linearise(position + late_s * velocity, pose)
    return Residuals(
        rows.time_s[own],
        kinematics.innovation(sensor.measurement[plot], then),
        _residual(rows, found.course)[own],
    )
