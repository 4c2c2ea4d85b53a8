"""Process noise that has seen the detections and their range rates.

A range rate is often more precise than what the process noise adds to a velocity in one scan. Of
the particles that were moved blindly few then have the measured range rate, and those that have
descend from few of the earlier ones. Part of the particles therefore draw their noise given a
detection's position and its range rate, as `proposal` does for positions alone.

Notes
-----
For the proposal the range rate of detection j is taken as linear in the noise e of particle i,
y_ij = g_ij' e + d_ij with d_ij of the radar's variance: g_ij is its gradient where the particle
is without noise, and y_ij the measured less the expected range rate there, in the fold next to what
position and prior predict. Given positions and these y_ij, noise and predictive densities p_ij are
those of a Kalman filter. The proposal is the mixture of the process noise itself, with share a, and
of the noise given each detection, with shares (1 - a) p_ij / sum_k p_ik. By Bayes' rule its density
at e, divided by that of the process noise, is a + (1 - a) sum_j l_ij(e) / sum_j p_ij, with l_ij the
linear model's likelihood. The weight is the inverse: it is exact whatever the linear model is off
by, which only costs efficiency. It is at most 1 / a. Each origin's mass is then scaled to what it
was before, so that the weights of an origin of few particles are exact only on average.

References
----------
Those of `proposal`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray, IntArray
from ...sensors.polar_geometry import LEAST_RANGE
from ...targets import motion
from ...targets.motion import MotionModel
from . import proposal
from .detections_in_plane import Places
from .proposal import BLIND_SHARE, GATE_SIGMA, MOST_PAIRS

# The process noise is guided by range rates whose deviation is below this many of the velocity's.
SHARP = 3.0

# Particles to a box of the search for those near a detection.
RUN = 128


@dataclass(frozen=True)
class _Pull:
    """What one detection tells of the noise of the particles near it.

    Parameters
    ----------
    index : int
        Of the detection.
    row : int array of shape (n,)
        The particles.
    error : array of shape (n, 2)
        Its position less that of each particle without noise, metres.
    gradient : array of shape (n, K)
        Of the range rate by the noise; zeros without a range rate.
    excess : array of shape (n,)
        Its range rate less that of each particle without noise, metres per second.
    gain : array of shape (n, K)
        Of the range rate, after the position.
    predictive : array of shape (n,)
        Density of the detection.
    """

    index: int
    row: IntArray
    error: FloatArray
    gradient: FloatArray
    excess: FloatArray
    gain: FloatArray
    predictive: FloatArray


def sample(
    model: MotionModel, state: FloatArray, dt: float, seen: Places, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draw the next state of every row, and the factor of its weight.

    Without precise range rates it is `proposal.sample`, whose parameters and results it has.
    """
    useful = _useful(model, dt, seen)
    if useful is None or not len(state) or len(useful) * len(state) > MOST_PAIRS:
        return proposal.sample(model, state, dt, seen, rng)
    moved = motion.sample(model, state, dt, rng)
    mean = model.mean(state, dt)
    linear = _Linear(model, dt, useful)
    boxes = _Boxes(mean, model)
    pulls = [linear.pull(index, mean, boxes) for index in range(len(useful))]
    total = np.zeros(len(state))
    for pull in pulls:
        total[pull.row] += pull.predictive
    _guide(moved, mean, pulls, total, linear, rng)
    explained = np.zeros(len(state))
    for pull in pulls:
        explained[pull.row] += linear.likelihood(pull, moved[pull.row] - mean[pull.row])
    ratio = np.divide(explained, total, out=np.ones(len(state)), where=total > 0.0)
    return moved, 1.0 / (BLIND_SHARE + (1.0 - BLIND_SHARE) * ratio)


def _useful(model: MotionModel, dt: float, seen: Places) -> Places | None:
    """Return the detections that guide; None if none of them does by its range rate."""
    if seen.rates is None:
        return None
    noise = np.sqrt(np.diag(model.noise_covariance(dt)))
    place = noise[model.support.index(model.space.position[0])]
    speed = noise[model.support.index(model.space.velocity[0])]
    rated = np.isfinite(seen.rates.rate) & (seen.rates.std < SHARP * speed)
    if not rated.any():
        return None
    sharp = np.linalg.eigvalsh(seen.covariance)[:, 1] < (proposal.SHARP * place) ** 2
    return seen.take(np.flatnonzero(rated | sharp))


class _Linear:
    """The linear model of the detections by the noise, by detection.

    Parameters
    ----------
    model : MotionModel
    dt : float
        Seconds.
    seen : Places
        With range rates.
    """

    def __init__(self, model: MotionModel, dt: float, seen: Places) -> None:
        if seen.rates is None:
            raise ValueError("seen: has no range rates")
        self.model, self.seen, self.rates = model, seen, seen.rates
        self.support = list(model.support)
        self._place = [model.support.index(axis) for axis in model.space.position]
        self._speed = [model.support.index(axis) for axis in model.space.velocity]
        # H of the position at each detection's time, (M, 2, K).
        self.observed = np.zeros((len(seen), 2, len(self.support)))
        for axis in range(2):
            self.observed[:, axis, self._place[axis]] = 1.0
            self.observed[:, axis, self._speed[axis]] = seen.time_s
        noise = model.noise_covariance(dt)
        cross = noise @ self.observed.swapaxes(1, 2)
        innovation = self.observed @ cross + seen.covariance
        self.inverse = np.linalg.inv(innovation)
        self.gain = cross @ self.inverse
        # Of the noise once the position is known, (M, K, K).
        self.left = noise - self.gain @ cross.swapaxes(1, 2)
        self._log_peak = -np.log(2.0 * np.pi) - 0.5 * np.log(np.linalg.det(innovation))
        self._reach = GATE_SIGMA * np.sqrt(np.diagonal(innovation, axis1=1, axis2=2))
        self.precision = np.linalg.inv(seen.covariance)
        self._log_own = -np.log(2.0 * np.pi) - 0.5 * np.log(np.linalg.det(seen.covariance))
        self.root = np.linalg.cholesky(seen.covariance)

    def pull(self, index: int, mean: FloatArray, boxes: _Boxes) -> _Pull:
        """Return what a detection tells of the noise of particles, (N, D) without noise."""
        row, error = self._near(index, mean, boxes)
        square = _square(error, self.inverse[index])
        kept = square <= GATE_SIGMA**2
        row, error, square = row[kept], error[kept], square[kept]
        log_density = self._log_peak[index] - 0.5 * square
        gradient = np.zeros((len(row), len(self.support)))
        excess, gain = np.zeros(len(row)), np.zeros_like(gradient)
        if np.isfinite(self.rates.rate[index]):
            expected, gradient = self._expected(index, mean[row])
            cross = gradient @ self.left[index]
            variance = (cross * gradient).sum(axis=1) + self.rates.std[index] ** 2
            by_place = (gradient * (error @ self.gain[index].T)).sum(axis=1)
            rest = self.rates.rate[index] - expected - by_place
            ambiguity = self.rates.ambiguity[index]
            if np.isfinite(ambiguity):
                rest -= ambiguity * np.round(rest / ambiguity)
            log_density -= 0.5 * (rest**2 / variance + np.log(2.0 * np.pi * variance))
            excess, gain = rest + by_place, cross / variance[:, None]
        return _Pull(index, row, error, gradient, excess, gain, np.exp(log_density))

    def _near(self, index: int, mean: FloatArray, boxes: _Boxes) -> tuple[IntArray, FloatArray]:
        """Return the particles in a box about a detection, and its position less theirs."""
        place, reach = self.seen.position[index], self._reach[index]
        time_s = float(self.seen.time_s[index])
        row = boxes.rows(place, reach, time_s)
        nearby = mean.take(row, axis=0)
        offset = place - nearby[:, list(self.model.space.position)]
        if time_s:
            offset -= time_s * nearby[:, list(self.model.space.velocity)]
        near = np.flatnonzero((np.abs(offset) <= reach).all(axis=1))
        return row[near], offset[near]

    def _expected(self, index: int, mean: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the range rates of particles without noise, and their gradients, (n, K)."""
        velocity = mean[:, list(self.model.space.velocity)]
        line = mean[:, list(self.model.space.position)] - self.rates.radar_position[index]
        line += self.seen.time_s[index] * velocity
        relative = velocity - self.rates.radar_velocity[index]
        distance = np.maximum(np.sqrt((line**2).sum(axis=1)), LEAST_RANGE)
        along = line / distance[:, None]
        rate: FloatArray = (along * relative).sum(axis=1)
        turned = (relative - rate[:, None] * along) / distance[:, None]
        gradient = np.zeros((len(mean), len(self.support)))
        gradient[:, self._place] = turned
        gradient[:, self._speed] = along + self.seen.time_s[index] * turned
        return rate, gradient

    def drawn(
        self, pull: _Pull, part: IntArray, noise: FloatArray, normal: FloatArray
    ) -> FloatArray:
        """Return noise given a detection, from draws of the noise without it.

        A draw plus gain times (measured - that of the draw - a draw of the measurement's error) is
        a draw given the measurement (Matheron's rule): the position first, then the range rate.

        Parameters
        ----------
        pull : _Pull
        part : int array of shape (n,)
            Rows of the pull.
        noise : array of shape (n, K)
        normal : array of shape (n, 3)
            Standard normal.
        """
        index = pull.index
        error = pull.error[part] - noise @ self.observed[index].T
        error -= normal[:, :2] @ self.root[index].T
        noise = noise + error @ self.gain[index].T
        rest = pull.excess[part] - (pull.gradient[part] * noise).sum(axis=1)
        rest -= self.rates.std[index] * normal[:, 2]
        told: FloatArray = noise + rest[:, None] * pull.gain[part]
        return told

    def likelihood(self, pull: _Pull, offset: FloatArray) -> FloatArray:
        """Return the likelihood of a detection by the linear model.

        Parameters
        ----------
        pull : _Pull
        offset : array of shape (n, D)
            The noise of the pull's particles.
        """
        index, noise = pull.index, offset[:, self.support]
        error = pull.error - noise @ self.observed[index].T
        log_density = self._log_own[index] - 0.5 * _square(error, self.precision[index])
        if np.isfinite(self.rates.rate[index]):
            rest = (pull.excess - (pull.gradient * noise).sum(axis=1)) / self.rates.std[index]
            log_norm = np.log(np.sqrt(2.0 * np.pi) * self.rates.std[index])
            log_density -= 0.5 * rest**2 + log_norm
        density: FloatArray = np.exp(log_density)
        return density


class _Boxes:
    """Boxes about runs of consecutive particles, to find those near a detection.

    The particles of one target follow one another, so that most runs are of one target.

    Parameters
    ----------
    mean : array of shape (N, D)
        N is at least 1.
    model : MotionModel
    """

    def __init__(self, mean: FloatArray, model: MotionModel) -> None:
        self._size = len(mean)
        start = np.arange(0, self._size, RUN)
        axes = [*model.space.position, *model.space.velocity]
        columns = np.ascontiguousarray(mean[:, axes].T)
        low = np.minimum.reduceat(columns, start, axis=1)
        high = np.maximum.reduceat(columns, start, axis=1)
        self._place = low[:2], high[:2]
        self._speed = low[2:], high[2:]

    def rows(self, place: FloatArray, reach: FloatArray, time_s: float) -> IntArray:
        """Return the particles of the runs that may come within `reach` of a place at a time."""
        moved = np.stack([time_s * bound for bound in self._speed])
        low = self._place[0] + moved.min(axis=0) - (place + reach)[:, None]
        high = self._place[1] + moved.max(axis=0) - (place - reach)[:, None]
        runs = np.flatnonzero(((low <= 0.0) & (high >= 0.0)).all(axis=0))
        row: IntArray = (RUN * runs[:, None] + np.arange(RUN)).ravel()
        return row[row < self._size]


def _guide(
    moved: FloatArray,
    mean: FloatArray,
    pulls: list[_Pull],
    total: FloatArray,
    linear: _Linear,
    rng: np.random.Generator,
) -> None:
    """Draw the noise of some particles given one of the detections near them, in place."""
    blind, bound = rng.random((2, len(moved)))
    # Summed in the same order as the total, so that what is below it is found.
    bound *= total
    open_ = (total > 0.0) & (blind >= BLIND_SHARE)
    running = np.zeros(len(moved))
    for pull in pulls:
        running[pull.row] += pull.predictive
        part = np.flatnonzero(open_[pull.row] & (running[pull.row] >= bound[pull.row]))
        row = pull.row[part]
        open_[row] = False
        place = np.ix_(row, np.array(linear.support))
        noise = moved[place] - mean[place]
        normal = rng.standard_normal((len(row), 3))
        moved[place] = mean[place] + linear.drawn(pull, part, noise, normal)


def _square(error: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return e' A e of each row of errors, (n, 2)."""
    east, north = error.T
    square: FloatArray = matrix[0, 0] * east**2 + 2.0 * matrix[0, 1] * east * north
    square += matrix[1, 1] * north**2
    return square
