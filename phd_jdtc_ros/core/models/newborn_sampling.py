"""Draws the states of newborn targets, and evaluates the intensity that they are drawn from."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from ..arrays import FloatArray, IntArray, sum_by
from ..sensors.range_rate import Rates
from ..sensors.report import Report
from ..sensors.sensor import Sensor
from ..targets.birth import shift_points
from ..targets.modes import ModeSpace
from ..targets.sobol import sobol_points
from .detection_birth import DetectionBirthModel, Newborn
from .tracker_model import TrackerModel

# Standard deviations of velocity and turn rate beyond which the newborn intensity counts as zero.
VELOCITY_GATE_SIGMA = 8.0
# Largest product of rows and detections in one chunk; bounds the memory.
CHUNK_PRODUCT = 1 << 25


def sample(
    newborn: Newborn, model: TrackerModel, count: int, rng: np.random.Generator
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Draw the newborn targets of one radar, `count` particles, a power of two, for each detection.

    Return states, (N, D), modes, (N,), weights in expected targets per particle, (N,), and the row
    of `newborn` that each particle comes from, (N,).
    """
    modes, births = model.modes, model.detection_births
    space = modes.space
    size, report = len(space), newborn.report
    measured_rates = report.range_rates
    dimensions = size + 1 + (measured_rates is not None)
    shift = rng.random((len(newborn), 1, dimensions))
    uniform = shift_points(sobol_points(dimensions, count), shift)
    normal = ndtri(uniform[..., 1 : size + 1])
    mass_by_mode = _mode_mass(newborn, modes)
    share = np.cumsum(mass_by_mode, axis=1) / mass_by_mode.sum(axis=1, keepdims=True)
    mode = (uniform[..., :1] >= share[:, None, :-1]).sum(axis=2).ravel()

    position = report.sensor.draw_in_plane(report.detections, normal[..., :2])
    state = np.zeros((len(newborn) * count, size))
    state[:, list(space.velocity)] = births.velocity_std * normal[..., 2:4].reshape(-1, 2)
    state[:, list(space.position)] = position.reshape(-1, 2)
    if measured_rates is not None:
        particle_rates = measured_rates.take(np.arange(len(newborn)).repeat(count))
        posterior_velocity = _draw_velocity_given_rate(
            position=state[:, list(space.position)],
            drawn=state[:, list(space.velocity)],
            measured=particle_rates,
            uniform=uniform[..., -1].ravel(),
            sensor=report.sensor,
            births=births,
        )
        state[:, list(space.velocity)] = posterior_velocity
    if report.detections.time_s is not None:  # predict back to the scan's stamp
        since = report.detections.time_s.repeat(count)[:, None]
        state[:, list(space.position)] -= since * state[:, list(space.velocity)]
    turning = np.array([space.turn_rate in motion.support for motion in modes.motions])[mode]
    state[:, space.turn_rate] = np.where(
        turning, births.turn_rate_std * normal[..., 4].ravel(), 0.0
    )
    detection = np.repeat(np.arange(len(newborn)), count)
    weight = (mass_by_mode.sum(axis=1) / count)[detection]
    return state, mode, weight, detection


def intensity(
    newborn: Newborn, model: TrackerModel, state: FloatArray, mode: IntArray
) -> FloatArray:
    """Return the intensity that `sample` draws from, over each mode's own support; shape (N,).

    Rows are processed in chunks: all pairs of a scan with many detections would exceed the memory.
    The measurement has a density over range and azimuth; its quotient by the range is the density
    over the plane.
    """
    size = max(CHUNK_PRODUCT // max(len(newborn), 1), 1)
    parts = [
        _intensity(newborn, model, state[first : first + size], mode[first : first + size])
        for first in range(0, len(state), size)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _intensity(
    newborn: Newborn, model: TrackerModel, state: FloatArray, mode: IntArray
) -> FloatArray:
    modes, births = model.modes, model.detection_births
    velocity, turn_rate = list(modes.space.velocity), modes.space.turn_rate
    slow = np.abs(state[:, velocity]).max(axis=1) <= VELOCITY_GATE_SIGMA * births.velocity_std
    slow &= np.abs(state[:, turn_rate]) <= VELOCITY_GATE_SIGMA * births.turn_rate_std
    rows = np.flatnonzero(slow)
    slow_state = state[rows]
    sensor, detections = newborn.report.sensor, newborn.report.detections
    predicted = sensor.measure(slow_state)
    rate = None if detections.time_s is None else sensor.measurement_rate(slow_state)
    row, column, log_density = sensor.gated_pairs(predicted, detections, rate)
    scaled = slow_state[row][:, velocity] / births.velocity_std
    log_density -= 0.5 * (scaled**2).sum(axis=1)
    log_density -= np.log(2.0 * np.pi * births.velocity_std**2)
    log_density += _log_rate_factor(newborn.report, births, slow_state, (row, column))
    log_density += sensor.log_jacobian(predicted[row])
    turning = np.array([turn_rate in motion.support for motion in modes.motions])[mode[rows[row]]]
    turn = slow_state[row, turn_rate] / births.turn_rate_std
    log_turn = -0.5 * turn**2 - np.log(births.turn_rate_std * np.sqrt(2.0 * np.pi))
    log_density += np.where(turning, log_turn, 0.0)
    mass = _mode_mass(newborn, modes)[column, mode[rows[row]]]
    return sum_by(rows[row], mass * np.exp(log_density), len(state))


def _draw_velocity_given_rate(
    position: FloatArray,
    drawn: FloatArray,
    measured: Rates,
    uniform: FloatArray,
    sensor: Sensor,
    births: DetectionBirthModel,
) -> FloatArray:
    """Return velocities drawn given the range rates of their detections, shape (N, 2).

    `position` has the positions at the time of the detection, and `drawn` the velocities drawn from
    the prior, (N, 2). The uniform numbers, (N,), select the fold.
    """
    toward = sensor.line_of_sight(position)
    radial = (drawn * toward).sum(axis=1)
    prior, noise = births.velocity_std**2, measured.std**2
    rates = measured.model
    radial_rate = rates.wrap(measured.rate + toward @ np.asarray(sensor.velocity))
    radial_rate = np.where(np.isfinite(radial_rate), radial_rate, 0.0)
    shifts = rates.folds(VELOCITY_GATE_SIGMA * float(np.sqrt(prior + np.max(noise, initial=0.0))))
    fold_rate = radial_rate[:, None] + shifts
    log_share = -0.5 * fold_rate**2 / (prior + noise)[:, None]
    share = np.cumsum(np.exp(log_share - log_share.max(axis=1, keepdims=True)), axis=1)
    fold = (uniform[:, None] * share[:, -1:] >= share[:, :-1]).sum(axis=1)
    gain = prior / (prior + noise)
    # Transforms a draw from the prior to the mean and the standard deviation of the posterior.
    posterior = gain * fold_rate[np.arange(len(fold_rate)), fold] + radial * np.sqrt(1.0 - gain)
    change = np.where(np.isfinite(measured.rate), posterior - radial, 0.0)
    return drawn + change[:, None] * toward


def _log_rate_factor(
    report: Report, births: DetectionBirthModel, state: FloatArray, pairs: tuple[IntArray, IntArray]
) -> FloatArray | float:
    """Return the log factor of range rates on the density of velocities, shape (P,).

    The posterior is the prior times the likelihood of the range rate, divided by its density.
    """
    measured, sensor, detections = report.range_rates, report.sensor, report.detections
    if measured is None:
        return 0.0
    row, column = pairs
    position = state[row][:, list(sensor.space.position)]
    if detections.time_s is not None:
        velocity = state[row][:, list(sensor.space.velocity)]
        position = position + detections.time_s[column][:, None] * velocity
    toward = sensor.line_of_sight(position)
    evidence = births.log_range_rate(toward, measured.take(column), sensor)
    return sensor.log_range_rate(state, detections, pairs) - evidence


def _mode_mass(newborn: Newborn, modes: ModeSpace) -> FloatArray:
    """Return each detection's newborn mass by flat mode, (M, O)."""
    return newborn.mass[:, modes.class_of] * modes.motion_share
