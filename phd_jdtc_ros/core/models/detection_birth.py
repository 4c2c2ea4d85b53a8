"""Births at detections, for targets that appear at unknown places.

Unknown targets have a uniform intensity in every sensor's own coordinates. In the update this
intensity competes for each detection with clutter and with the known targets. Its share is the
detection's newborn mass, which is added to the intensity at the detection's position with the
radar's noise and a broad distribution of velocity. A range rate determines the radial velocity up
to its ambiguity. Where earlier radars of the scan have coverage, only the unknown targets that they
missed remain for the next one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from ..arrays import FloatArray, IntArray, read_only, sum_by
from ..sensors.range_rate import Rates
from ..sensors.report import Report
from ..sensors.sensor import Sensor
from ..targets.birth import shift_points
from ..targets.modes import ModeSpace
from ..targets.sobol import sobol_points
from ..types import Detections
from . import stationary

# Standard deviations of velocity and turn rate beyond which the newborn intensity counts as zero.
GATE_SIGMA = 8.0
# Fewest particles that represent a newborn target; with less capacity, detections are left out.
LEAST_PARTICLES = 16
# Largest product of rows and detections in one chunk; bounds the memory.
CHUNK_PRODUCT = 1 << 25


@dataclass(frozen=True)
class DetectionBirthModel:
    """The rate of unknown targets, and the distribution of their velocity.

    Parameters
    ----------
    rate : array of shape (C,)
        Expected births in a radar's field per nominal interval and class; all zero for none.
    velocity_std : float
        Standard deviation of the velocity along each axis, metres per second.
    turn_rate_std : float
        Standard deviation of the turn rate, radians per second.
    particles : int
        Particles per detection; a power of two.
    most : int
        Largest number of particles at the detections of one radar in one scan.
    least_mass : float
        Smallest newborn mass with which a detection gets particles.
    """

    rate: FloatArray
    velocity_std: float
    turn_rate_std: float
    particles: int
    most: int = 1 << 24
    least_mass: float = 1e-4

    def __post_init__(self) -> None:
        object.__setattr__(self, "rate", read_only(self.rate))

    @property
    def enabled(self) -> bool:
        """Whether any class has births at detections."""
        return bool(np.any(self.rate > 0.0))

    def log_intensity(
        self,
        report: Report,
        modes: ModeSpace,
        dt: float,
        earlier: Sequence[Newborn] = (),
    ) -> FloatArray:
        """Return log of the unknown targets' intensity at each detection, shape (C, M).

        It covers targets that appeared in the preceding `dt` seconds, or, for the detections of a
        sector, since the antenna's previous pass. It is the counterpart of the clutter intensity:
        uniform over the sensor's field of view, times p_D g^tau of each class, times the density
        of the range rate, and times 1 - p_D of the scan's `earlier` reports, which are given by the
        targets born at their detections.
        """
        sensor, detections = report.sensor, report.detections
        since = dt if detections.coverage is None else sensor.rotation_s or dt
        appeared = self.rate * since / modes.interval_s
        place = sensor.to_world(detections.measurement)
        left = missed_by(earlier, place, modes)
        # The intensity is zero for classes without births, and where an earlier radar has p_D = 1.
        with np.errstate(divide="ignore"):
            log_rate = np.log(appeared / sensor.field_size)
            log_left = np.log(left)
        likelihood = sensor.log_class_likelihood(detections, modes.classes)
        intensity: FloatArray = log_rate[:, None] + likelihood + log_left
        if (measured := report.range_rates) is not None:
            toward = sensor.line_of_sight(place)
            intensity = intensity + self.log_range_rate(toward, measured, sensor)
        return intensity

    def stationary(self, slower: FloatArray, bound: float) -> FloatArray:
        """Return the probability of being stationary at even prior odds, given that of being slow.

        Without births at detections the prior at birth is unknown, and `slower` is returned
        unchanged. See `stationary.at_even_odds`.
        """
        return stationary.at_even_odds(slower, bound, self.velocity_std) if self.enabled else slower

    def log_range_rate(self, toward: FloatArray, measured: Rates, sensor: Sensor) -> FloatArray:
        """Return the log density of range rates of targets of unknown velocity, shape (M,).

        Parameters
        ----------
        toward : array of shape (M, 2)
            Directions from the sensor to the targets, world frame.
        measured : Rates
            M range rates; for NaN the result is 0.
        sensor : Sensor
        """
        radial = measured.rate + toward @ np.asarray(sensor.velocity)
        return measured.model.log_density(radial, self.velocity_std**2 + measured.std**2)


@dataclass(frozen=True)
class Newborn:
    """Possible new targets at the detections of one report.

    Parameters
    ----------
    report : Report
        Of J detections.
    mass : array of shape (J, C)
        Probability that each detection is a new target of each class.
    """

    report: Report
    mass: FloatArray

    def __len__(self) -> int:
        return len(self.report)

    def take(self, rows: IntArray) -> Newborn:
        """Return the newborn targets of these rows."""
        return Newborn(self.report.take(rows), self.mass[rows])


def newborn(report: Report, mass: FloatArray, model: DetectionBirthModel) -> Newborn:
    """Return the detections with at least the model's `least_mass`, given masses (M, C)."""
    kept = np.flatnonzero(mass.sum(axis=1) >= model.least_mass)
    return Newborn(report, mass).take(kept)


def missed_by(earlier: Sequence[Newborn], position: FloatArray, modes: ModeSpace) -> FloatArray:
    """Return the probability that sensors miss a target at each position, (M, 2) to (C, M).

    A sensor's probability is its mean over the SNR band of the class.
    """
    missed = np.ones((len(modes.classes), len(position)))
    for found in earlier:
        report, sensor = found.report, found.report.sensor
        measured, _ = sensor.linearise(position)
        seen = sensor.missable(measured, report.detections.coverage) * report.share
        log_p_d = sensor.log_class_likelihood(Detections(measured, None), modes.classes)
        missed *= 1.0 - seen * np.exp(log_p_d)
    return missed


def affordable(found: Newborn, model: DetectionBirthModel) -> tuple[Newborn, int]:
    """Return the newborn targets within the model's `most` particles, and the particles of each.

    The number of particles per detection is reduced first; then the detections with the least
    newborn mass are left out.
    """
    count = model.particles
    least = min(LEAST_PARTICLES, count)
    while count > least and len(found) * count > model.most:
        count //= 2
    kept = max(model.most // count, 1)
    if len(found) <= kept:
        return found, count
    order = np.argsort(-found.mass.sum(axis=1), kind="stable")
    rows = np.sort(order[:kept])
    return found.take(rows), count


def sample(
    found: Newborn,
    model: DetectionBirthModel,
    modes: ModeSpace,
    count: int,
    rng: np.random.Generator,
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Draw the newborn targets of one radar.

    Parameters
    ----------
    found : Newborn
        J detections.
    model : DetectionBirthModel
    modes : ModeSpace
    count : int
        Particles per detection; a power of two.
    rng : numpy.random.Generator

    Returns
    -------
    state : array of shape (N, D)
        In the world frame; N is J times `count`.
    mode : int array of shape (N,)
    weight : array of shape (N,)
        Expected targets per particle.
    detection : int array of shape (N,)
        The row of `found` that each particle comes from.
    """
    space = modes.space
    size, report = len(space), found.report
    measured_rates = report.range_rates
    dimensions = size + 1 + (measured_rates is not None)
    shift = rng.random((len(found), 1, dimensions))
    uniform = shift_points(sobol_points(dimensions, count), shift)
    normal = ndtri(uniform[..., 1 : size + 1])
    per_mode = _mode_mass(found, modes)
    share = np.cumsum(per_mode, axis=1) / per_mode.sum(axis=1, keepdims=True)
    mode = (uniform[..., :1] >= share[:, None, :-1]).sum(axis=2).ravel()

    position = report.sensor.drawn_in_plane(report.detections, normal[..., :2])
    state = np.zeros((len(found) * count, size))
    state[:, list(space.velocity)] = model.velocity_std * normal[..., 2:4].reshape(-1, 2)
    state[:, list(space.position)] = position.reshape(-1, 2)
    if measured_rates is not None:
        repeated = measured_rates.take(np.arange(len(found)).repeat(count))
        known = _known_velocity(
            *(state[:, list(space.position)], state[:, list(space.velocity)], repeated),
            *(uniform[..., -1].ravel(), report.sensor, model),
        )
        state[:, list(space.velocity)] = known
    if report.detections.time_s is not None:  # predict back to the scan's stamp
        since = report.detections.time_s.repeat(count)[:, None]
        state[:, list(space.position)] -= since * state[:, list(space.velocity)]
    turning = np.array([space.turn_rate in motion.support for motion in modes.motions])[mode]
    state[:, space.turn_rate] = np.where(turning, model.turn_rate_std * normal[..., 4].ravel(), 0.0)
    detection = np.repeat(np.arange(len(found)), count)
    weight = (per_mode.sum(axis=1) / count)[detection]
    return state, mode, weight, detection


def intensity(
    found: Newborn,
    model: DetectionBirthModel,
    modes: ModeSpace,
    state: FloatArray,
    mode: IntArray,
) -> FloatArray:
    """Return the intensity that `sample` draws from, over each mode's own support; shape (N,).

    Rows are processed in chunks: all pairs of a scan with many detections would exceed the memory.

    Notes
    -----
    The measurement has a density over range and azimuth; its quotient by the range is the density
    over the plane.
    """
    size = max(CHUNK_PRODUCT // max(len(found), 1), 1)
    parts = [
        _intensity(found, model, modes, state[first : first + size], mode[first : first + size])
        for first in range(0, len(state), size)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _intensity(
    found: Newborn,
    model: DetectionBirthModel,
    modes: ModeSpace,
    state: FloatArray,
    mode: IntArray,
) -> FloatArray:
    velocity, turn_rate = list(modes.space.velocity), modes.space.turn_rate
    slow = np.abs(state[:, velocity]).max(axis=1) <= GATE_SIGMA * model.velocity_std
    slow &= np.abs(state[:, turn_rate]) <= GATE_SIGMA * model.turn_rate_std
    rows = np.flatnonzero(slow)
    slow_state = state[rows]
    sensor, detections = found.report.sensor, found.report.detections
    predicted = sensor.measure(slow_state)
    rate = None if detections.time_s is None else sensor.measurement_rate(slow_state)
    row, column, log_density = sensor.gated_pairs(predicted, detections, rate)
    scaled = slow_state[row][:, velocity] / model.velocity_std
    log_density -= 0.5 * (scaled**2).sum(axis=1)
    log_density -= np.log(2.0 * np.pi * model.velocity_std**2)
    log_density += _log_rate_factor(found.report, model, slow_state, (row, column))
    log_density += sensor.log_jacobian(predicted[row])
    turning = np.array([turn_rate in motion.support for motion in modes.motions])[mode[rows[row]]]
    turn = slow_state[row, turn_rate] / model.turn_rate_std
    log_turn = -0.5 * turn**2 - np.log(model.turn_rate_std * np.sqrt(2.0 * np.pi))
    log_density += np.where(turning, log_turn, 0.0)
    mass = _mode_mass(found, modes)[column, mode[rows[row]]]
    return sum_by(rows[row], mass * np.exp(log_density), len(state))


def _known_velocity(
    position: FloatArray,
    drawn: FloatArray,
    measured: Rates,
    uniform: FloatArray,
    sensor: Sensor,
    model: DetectionBirthModel,
) -> FloatArray:
    """Return velocities drawn given the range rates of their detections, shape (N, 2).

    Parameters
    ----------
    position, drawn : arrays of shape (N, 2)
        Positions at the time of the detection, and velocities drawn from the prior.
    measured : Rates
        Range rate of each row.
    uniform : array of shape (N,)
        In [0, 1); selects the fold.
    sensor : Sensor
    model : DetectionBirthModel
    """
    toward = sensor.line_of_sight(position)
    radial = (drawn * toward).sum(axis=1)
    prior, noise = model.velocity_std**2, measured.std**2
    rates = measured.model
    value = rates.wrap(measured.rate + toward @ np.asarray(sensor.velocity))
    value = np.where(np.isfinite(value), value, 0.0)
    shifts = rates.folds(GATE_SIGMA * float(np.sqrt(prior + np.max(noise, initial=0.0))))
    each = value[:, None] + shifts
    log_share = -0.5 * each**2 / (prior + noise)[:, None]
    share = np.cumsum(np.exp(log_share - log_share.max(axis=1, keepdims=True)), axis=1)
    fold = (uniform[:, None] * share[:, -1:] >= share[:, :-1]).sum(axis=1)
    gain = prior / (prior + noise)
    # Transforms a draw from the prior to the mean and the standard deviation of the posterior.
    posterior = gain * each[np.arange(len(each)), fold] + radial * np.sqrt(1.0 - gain)
    change = np.where(np.isfinite(measured.rate), posterior - radial, 0.0)
    velocity: FloatArray = drawn + change[:, None] * toward
    return velocity


def _log_rate_factor(
    report: Report,
    model: DetectionBirthModel,
    state: FloatArray,
    pairs: tuple[IntArray, IntArray],
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
    evidence = model.log_range_rate(toward, measured.take(column), sensor)
    return sensor.log_range_rate(state, detections, pairs) - evidence


def _mode_mass(found: Newborn, modes: ModeSpace) -> FloatArray:
    """Return each detection's newborn mass by flat mode, uniform over a class's motions; (J, O)."""
    motions_of_class = np.bincount(modes.class_of)
    mass: FloatArray = (found.mass / motions_of_class)[:, modes.class_of]
    return mass
