"""The targets that several radars see, and the filter that estimates the radars' biases with them.

Tracks of different radars are compared at common times. The nearest ones are joined first, and
simultaneous tracks of one radar never belong to one target.

For given biases a target moves at nearly constant velocity, and several radars measure it. The
innovations of its filter are linear in the biases. Each filter therefore also propagates the
derivative of its mean with respect to every bias, and the sum over all innovations is a least
squares problem in the biases alone. It has the same information as the problem in all states and
biases (Rosenberg 1973).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import combinations

import numpy as np

from phd_jdtc_ros.calibration import kinematics
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.sensors.bias import SensorBias

from .tracked_radars import TrackedRadar

# Interval of the comparison in scans of the slowest radar, largest number of times, and least
# number of times that two tracks must share.
STEP_LOOKS, MOST_TIMES, LEAST_TIMES = 1.5, 1000, 4
# Largest expected biases before any is estimated: of ranges in standard deviations and as a share
# of the range, of azimuths in radians, and of times in seconds.
RANGE_STDS, RANGE_SHARE, AZIMUTH, TIME_S = 10.0, 0.01, np.radians(1.5), 1.5
# Tolerated variation of the distance along the tracks: a share of the distance, and in addition
# standard deviations of a plot.
VARIATION_SHARE, VARIATION_STDS = 0.35, 2.0

Track = tuple[int, int]
Target = tuple[Track, ...]


@dataclass(frozen=True)
class _SampledTracks:
    """The tracks of one radar at common times."""

    position: FloatArray  # NaN at times without the track, (N, K, 2)
    plot_std: FloatArray  # Standard deviation of a plot's position, metres, (N,)
    reach: FloatArray  # Largest displacement of the track by the radar's biases, metres, (N,)


def common_targets(
    radars: Sequence[TrackedRadar], biases: Sequence[SensorBias], known: bool
) -> list[Target]:
    """Return the targets that several radars have tracked, each with tracks of at least two.

    `biases` are the current estimates of each radar's; `known` says whether they are estimated
    already, so that the tracks of a target are close.
    """
    times = _times(radars)
    sampled = [_sample_tracks(each, bias, times) for each, bias in zip(radars, biases, strict=True)]
    pairs = [
        pair
        for first, second in combinations(range(len(radars)), 2)
        for pair in _near(first, second, sampled, known)
    ]
    groups = _TrackGroups(radars)
    for _, first, second in sorted(pairs):
        groups.join(first, second)
    return [target for target in groups.targets() if len({radar for radar, _ in target}) > 1]


def _times(radars: Sequence[TrackedRadar]) -> FloatArray:
    """Return the times at which tracks are compared, ascending, seconds."""
    begin = max(float(each.time_s[0]) for each in radars)
    end = min(float(each.time_s[-1]) for each in radars)
    step = STEP_LOOKS * max(each.look_s for each in radars)
    count = int(np.clip((end - begin) / step + 1.0, 2, MOST_TIMES)) if end > begin else 0
    return np.linspace(begin, end, count)


def _sample_tracks(radar: TrackedRadar, bias: SensorBias, times: FloatArray) -> _SampledTracks:
    corrected = radar.remove_bias(bias)
    positions = corrected.position
    position = np.full((len(radar.tracks), len(times), 2), np.nan)
    plot_std, reach = np.zeros(len(radar.tracks)), np.zeros(len(radar.tracks))
    for row, own in enumerate(radar.tracks):
        time_s, place = corrected.time_s[own], positions[own]
        inside = (times >= time_s[0]) & (times <= time_s[-1])
        for axis in (0, 1):
            position[row, inside, axis] = np.interp(times[inside], time_s, place[:, axis])
        distance = float(np.mean(corrected.measurement[own, 0]))
        speed = float(np.hypot(*(place[-1] - place[0]))) / max(time_s[-1] - time_s[0], 1e-9)
        range_std, azimuth_std = radar.noise_std
        plot_std[row] = np.hypot(range_std, distance * azimuth_std)
        share = 0.0 if radar.exact else RANGE_SHARE + AZIMUTH
        reach[row] = RANGE_STDS * range_std + share * distance + TIME_S * speed
    return _SampledTracks(position, plot_std, reach)


def _near(
    first: int, second: int, sampled: Sequence[_SampledTracks], known: bool
) -> Iterator[tuple[float, Track, Track]]:
    """Yield the distance of each pair of tracks that may belong to one target, and the pair."""
    one, other = sampled[first], sampled[second]
    for row in range(len(one.position)):
        exists = ~np.isnan(one.position[row, :, 0])
        apart = other.position[:, exists] - one.position[row, exists]
        both = ~np.isnan(apart[..., 0])
        count = np.maximum(both.sum(axis=1), 1)
        mean = np.where(both[..., None], apart, 0.0).sum(axis=1) / count[:, None]
        off = np.where(both[..., None], apart - mean[:, None], 0.0)
        variation = np.sqrt((off**2).sum(axis=(1, 2)) / count)
        plot_std = np.hypot(one.plot_std[row], other.plot_std)
        # Largest mean distance of two tracks of one target once biases are estimated, in standard
        # deviations of a plot.
        limit = 2.0 * plot_std if known else np.hypot(one.reach[row], other.reach)
        distance = np.hypot(mean[:, 0], mean[:, 1]) / limit
        near = (both.sum(axis=1) >= LEAST_TIMES) & (distance < 1.0)
        near &= variation < VARIATION_SHARE * limit + VARIATION_STDS * plot_std
        for column in np.flatnonzero(near).tolist():
            yield float(distance[column]), (first, row), (second, column)


class _TrackGroups:
    """Groups tracks into targets."""

    def __init__(self, radars: Sequence[TrackedRadar]) -> None:
        self._span = {
            (radar, row): (float(each.time_s[own[0]]), float(each.time_s[own[-1]]))
            for radar, each in enumerate(radars)
            for row, own in enumerate(each.tracks)
        }
        self._target: dict[Track, list[Track]] = {track: [track] for track in self._span}

    def join(self, first: Track, second: Track) -> None:
        """Join the targets of two tracks, unless one radar would have two simultaneous tracks."""
        one, other = self._target[first], self._target[second]
        if one is other or any(self._at_once(a, b) for a in one for b in other):
            return
        one += other
        for track in other:
            self._target[track] = one

    def _at_once(self, first: Track, second: Track) -> bool:
        (begin, end), (start, stop) = self._span[first], self._span[second]
        return first[0] == second[0] and begin < stop and start < end

    def targets(self) -> list[Target]:
        """Return all targets, in the order of their first tracks."""
        unique = {id(target): target for target in self._target.values()}
        return [tuple(sorted(target)) for target in unique.values()]


@dataclass(frozen=True)
class Sequences:
    """The plots of T targets by time, at most K each, padded; known biases are removed."""

    valid: BoolArray  # False for padding, (K, T)
    time_s: FloatArray  # Ascending, seconds, (K, T)
    measurement: FloatArray  # (K, T, 2)
    pose: FloatArray  # Pose of the radar at each plot, (K, T, 3)
    radar: IntArray  # Radar of each plot, (K, T)
    plot: IntArray  # Index among the plots of its radar, (K, T)
    position: FloatArray  # Measured position, world frame, metres, (K, T, 2)
    noise_std: FloatArray  # Metres and radians, (K, T, 2)


def _pad_rows(rows: Sequence[IntArray]) -> tuple[IntArray, BoolArray]:
    """Return T rows as columns (K, T), padded with their last entry, and the mask of valid ones."""
    length = np.array([len(row) for row in rows])
    step = np.arange(length.max())[:, None]
    place = np.cumsum(length) - length + np.minimum(step, length - 1)
    columns: IntArray = np.concatenate(rows)[place]
    return columns, step < length


def sequences(
    radars: Sequence[TrackedRadar], biases: Sequence[SensorBias], targets: Sequence[Target]
) -> Sequences:
    """Return the plots of common targets with known biases removed."""
    corrected = [each.remove_bias(bias) for each, bias in zip(radars, biases, strict=True)]
    radar_rows, plot_rows = [], []
    for target in targets:
        own = [radars[radar].tracks[row] for radar, row in target]
        index = np.repeat([radar for radar, _ in target], [len(rows) for rows in own])
        time_s = [corrected[r].time_s[rows] for (r, _), rows in zip(target, own, strict=True)]
        order = np.argsort(np.concatenate(time_s), kind="stable")
        radar_rows.append(index[order])
        plot_rows.append(np.concatenate(own)[order])
    (radar, valid), (plot, _) = _pad_rows(radar_rows), _pad_rows(plot_rows)

    def gather(columns: Sequence[FloatArray]) -> FloatArray:
        """Return the value of each plot in its radar's column."""
        found = np.zeros((*radar.shape, *columns[0].shape[1:]))
        for index, column in enumerate(columns):
            own = radar == index
            found[own] = column[plot[own]]
        return found

    return Sequences(
        valid,
        gather([each.time_s for each in corrected]),
        gather([each.measurement for each in corrected]),
        gather([each.pose for each in radars]),
        radar,
        plot,
        gather([each.position for each in corrected]),
        np.array([each.noise_std for each in radars])[radar],
    )


# The biases of one radar, in the order of a `SensorBias`, and the unit of each in the equations.
KINDS = tuple(entry.name for entry in fields(SensorBias))
UNITS = np.array([100.0, 1e-3, 1e-3, 0.1])
# Standard deviations of position and velocity before the first plot, m and m/s.
ANYWHERE, ANY_SPEED = 1e6, 1e3


@dataclass(frozen=True)
class Trajectories:
    """Trajectories for the linearisation."""

    position: FloatArray  # (K, T, 2)
    velocity: FloatArray  # (K, T, 2)


class Pass:
    """The result of a filter's pass over T targets, with the normal equations of the P biases.

    The biases are in `UNITS`, ordered by radar. `information_of`, (T, P, P), and `score`, (T, P),
    are the information matrix and the right-hand side from each target. The filtered x, y, vx, vy
    are `mean`, (K, T, 4), with `covariance`, (K, T, 4, 4), and `response`, (K, T, 4, P), the
    derivative of the mean with respect to each bias.
    """

    def __init__(self, length: int, targets: int, biases: int) -> None:
        self.information_of = np.zeros((targets, biases, biases))
        self.score = np.zeros((targets, biases))
        self.mean = np.zeros((length, targets, 4))
        self.response = np.zeros((length, targets, 4, biases))
        self.covariance = np.zeros((length, targets, 4, 4))
        # Log likelihood without biases.
        self._log_likelihood = 0.0

    def add(self, found: kinematics.Innovation, sensitivity: FloatArray, valid: FloatArray) -> None:
        """Add an innovation of each target, with its sensitivity to the biases, (T, 2, P)."""
        weighted = valid[:, None, None] * (found.inverse @ sensitivity)
        self.information_of += sensitivity.swapaxes(1, 2) @ weighted
        self.score += np.einsum("tip,ti->tp", weighted, found.value)
        self._log_likelihood -= 0.5 * float(valid @ (np.log(found.determinant) + found.distance2))

    @property
    def information(self) -> FloatArray:
        """Information matrix from all targets, shape (P, P)."""
        total: FloatArray = self.information_of.sum(axis=0)
        return total

    @property
    def log_likelihood(self) -> float:
        """Log likelihood of the best biases."""
        score = self.score.sum(axis=0)
        best = self.bias_estimate(np.ones(len(score), dtype=bool))
        return self._log_likelihood + 0.5 * float(best @ score)

    def bias_estimate(self, free: BoolArray) -> FloatArray:
        """Return the least-squares estimate of the biases, shape (P,); 0 if not free."""
        rows = np.flatnonzero(free)
        information = self.information[np.ix_(rows, rows)]
        found = np.zeros(len(free))
        found[rows] = np.linalg.lstsq(information, self.score.sum(axis=0)[rows], rcond=None)[0]
        return found


def filter_targets(
    sequences: Sequences,
    trajectories: Trajectories,
    density: float,
    weight: FloatArray,
    radars: int,
) -> Pass:
    """Filter the targets, and return the equations of the biases.

    `density` is the spectral density of the white acceleration, m^2/s^3; the weights of the
    plots, (K, T), in (0, 1], divide their standard deviations.
    """
    length, targets = sequences.radar.shape
    expected, jacobian = kinematics.linearise(trajectories.position, sequences.pose)
    residual = kinematics.residual(sequences.measurement, expected)
    derivative = _derivative(sequences.radar, expected, jacobian, trajectories.velocity, radars)
    variance = (sequences.noise_std / weight[..., None]) ** 2
    found = Pass(length, targets, len(KINDS) * radars)
    mean = np.zeros((targets, 4))
    mean[:, :2] = trajectories.position[0]
    covariance = np.tile(np.diag([ANYWHERE**2] * 2 + [ANY_SPEED**2] * 2), (targets, 1, 1))
    response = np.zeros(found.response.shape[1:])
    time_s = sequences.time_s
    for k in range(length):
        dt = time_s[k] - time_s[k - 1] if k else np.zeros(targets)
        mean, covariance = kinematics.predict(mean, covariance, dt, np.full(targets, density))
        response = response.copy()
        response[:, :2] += dt[:, None, None] * response[:, 2:]
        slope, valid = jacobian[k], sequences.valid[k].astype(np.float64)
        value = residual[k] - _cloud_times(slope, mean[:, :2] - trajectories.position[k])
        innovation = kinematics.innovation_of(value, covariance, slope, variance[k])
        sensitivity = derivative[k] - slope @ response[:, :2]
        found.add(innovation, sensitivity, valid)
        gain = valid[:, None, None] * innovation.gain
        mean = mean + _cloud_times(gain, value)
        response = response + gain @ sensitivity
        covariance = covariance - gain @ innovation.cross.swapaxes(1, 2)
        covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))
        found.mean[k], found.response[k], found.covariance[k] = mean, response, covariance
    return found


def smooth_targets(
    sequences: Sequences, found: Pass, biases: FloatArray, density: float
) -> Trajectories:
    """Return the Rauch-Tung-Striebel means, given the biases in `UNITS`, shape (P,)."""
    mean = found.mean - found.response @ biases
    length, targets = sequences.radar.shape
    state = np.zeros((length, targets, 4))
    state[-1] = mean[-1]
    noise = np.full(targets, density)
    for k in range(length - 2, -1, -1):
        dt = sequences.time_s[k + 1] - sequences.time_s[k]
        ahead, grown = kinematics.predict(mean[k], found.covariance[k], dt, noise)
        cross = found.covariance[k].copy()
        cross[:, :, :2] += dt[:, None, None] * found.covariance[k][:, :, 2:]
        off = np.linalg.solve(grown, (state[k + 1] - ahead)[..., None])
        state[k] = mean[k] + (cross @ off)[..., 0]
    return Trajectories(state[..., :2], state[..., 2:])


def _derivative(
    radar: IntArray, expected: FloatArray, jacobian: FloatArray, velocity: FloatArray, radars: int
) -> FloatArray:
    """Return the derivative of each plot with respect to all biases in `UNITS`, (K, T, 2, P).

    A plot with a late time shows its target at an earlier position.
    """
    own = np.zeros((*expected.shape, len(KINDS)))
    own[..., 0, 0] = 1.0
    own[..., 0, 1] = expected[..., 0]
    own[..., 1, 2] = 1.0
    own[..., 3] = -_cloud_times(jacobian, velocity)
    of_radar = np.eye(radars)[radar][..., None, :, None]
    every: FloatArray = of_radar * (own * UNITS)[..., None, :]
    return every.reshape(*expected.shape, -1)


def _cloud_times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    product: FloatArray = (matrix @ vector[..., None])[..., 0]
    return product
