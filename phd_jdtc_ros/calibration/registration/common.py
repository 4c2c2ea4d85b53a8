"""Each radar's tracks, the targets that several radars see, and the filter that shows their biases.

A receiver of self-reports takes part as a radar without bias, so far away that its errors are the
same in all directions; its tracks are those of the addresses.

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
from dataclasses import dataclass, fields, replace
from itertools import combinations

import numpy as np

from phd_jdtc_ros.calibration import kinematics
from phd_jdtc_ros.calibration.tuning.plots import Timing
from phd_jdtc_ros.calibration.tuning.tracks import Tracks, guess_of, link_plots
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray, wrap_angle
from phd_jdtc_ros.core.sensors.bias import SensorBias
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import UNKNOWN, SelfReports

from ..tuning.plots import Plots

# Candidate speeds of targets, metres per second, and number of scans on which they are tried.
SPEEDS, LOOKS = (5.0, 40.0, 200.0), 12.0
# Least number of clouds of each radar, and of plots in tracks.
LEAST_CLOUDS, LEAST_PLOTS = 5, 20


@dataclass(frozen=True)
class TrackedRadar:
    """The plots of a radar, linked to tracks."""

    name: str
    time_s: FloatArray  # Times of its plots since the common reference, seconds, (N,)
    measurement: FloatArray  # (N, 2)
    # Pose of the radar in the world frame at each plot, metres and radians, (N, 3).
    pose: FloatArray
    noise_std: FloatArray  # Metres and radians, (2,)
    look_s: float  # Time between two opportunities to detect a target, seconds
    tracks: tuple[IntArray, ...]  # Indices of each track's plots in the order of time
    exact: bool = False  # Whether it has no bias

    @property
    def position(self) -> FloatArray:
        """Positions of the plots in the world frame, metres, (N, 2)."""
        return kinematics.positions(self.measurement, self.pose)

    def remove_bias(self, bias: SensorBias) -> TrackedRadar:
        """Return the radar with these biases removed from its plots."""
        distance = np.maximum(bias.true_range(self.measurement[:, 0]), 0.0)
        azimuth = wrap_angle(self.measurement[:, 1] - bias.azimuth)
        return replace(
            self,
            time_s=self.time_s - bias.time_offset_s,
            measurement=np.stack([distance, azimuth], axis=1),
        )


def tracked_radar(plots: Plots, radar: RadarModel, zero_ns: int, moving: bool) -> TrackedRadar:
    """Link a radar's plots to tracks, with times since `zero_ns`.

    The plots have the radar's poses if it is `moving`. Raise `RegistrationError` if they have no
    comparable times, or form no tracks.
    """
    clouds = len(plots.cloud_s)
    if clouds < LEAST_CLOUDS:
        raise RegistrationError(
            f"{radar.name}: {clouds} clouds in {plots.duration_s:.1f} s, must be at least "
            f"{LEAST_CLOUDS}, better ten minutes"
        )
    if radar.rotation_s and len(plots) and not plots.timed:
        raise RegistrationError(
            f"{radar.name}: rotates in {radar.rotation_s:g} s, but its detections have no "
            "individual times; map them with fields.time, because one stamp per revolution does "
            "not date the detections"
        )
    interval_s = float(np.median(np.diff(plots.cloud_s)))
    if interval_s <= 0.0:
        raise RegistrationError(
            f"{radar.name}: all clouds have the same stamp; stamps must increase"
        )
    timing = Timing(interval_s, radar.rotation_s)
    tracks = _tracks(plots, timing, radar)
    if len(tracks.claimed) < LEAST_PLOTS:
        raise RegistrationError(
            f"{radar.name}: {len(tracks.plots)} tracks of {len(tracks.claimed)} plots, of "
            f"{len(plots)} detections in {plots.duration_s:.1f} s; must be at least "
            f"{LEAST_PLOTS} plots in tracks: record longer, or check its range_std and "
            "azimuth_std_deg"
        )
    stationary = np.tile([*radar.position, radar.yaw], (len(plots), 1))
    return TrackedRadar(
        radar.name,
        plots.time_s + (plots.zero_ns - zero_ns) * 1e-9,
        plots.measurement,
        plots.pose if moving else stationary,
        radar.noise_std,
        timing.look_s,
        tracks.plots,
    )


def tracked_reports(
    name: str, reports: SelfReports, usual_std: float, zero_ns: int
) -> TrackedRadar:
    """Return the self-reports of a receiver as plots of a radar; see `tracked_radar`.

    `usual_std` is the standard deviation of positions along each axis without one of their own,
    metres.
    """
    # How far from the world's origin reports are seen from, metres.
    away = 1e6
    reports = reports.take(np.flatnonzero(reports.address != UNKNOWN))
    reports = reports.take(np.argsort(reports.time_ns, kind="stable"))
    if not len(reports):
        raise RegistrationError(f"{name}: no report with an address")
    time_s = np.asarray((reports.time_ns - zero_ns) * 1e-9, dtype=np.float64)
    order = np.lexsort((reports.time_ns, reports.address, reports.space))
    same = (np.diff(reports.address[order]) == 0) & (np.diff(reports.space[order]) == 0)
    apart_s = np.diff(time_s[order])
    # Reports of an address are of one track up to this time between them, seconds.
    tracks = np.split(order, np.flatnonzero(~same | (apart_s > 30.0)) + 1)
    pose = np.tile([-away, 0.0, 0.0], (len(reports), 1))
    measurement = kinematics.linearise(reports.position, pose)[0]
    variance = np.einsum("mkk->mk", reports.covariance).mean(axis=1)
    std = float(np.median(np.sqrt(np.where(np.isfinite(variance), variance, usual_std**2))))
    interval_s = float(np.median(apart_s[same])) if same.any() else 1.0
    return TrackedRadar(
        name,
        time_s,
        measurement,
        pose,
        np.array([std, std / away]),
        max(interval_s, 0.1),
        tuple(track for track in tracks if len(track) > 1),
        exact=True,
    )


def _tracks(plots: Plots, timing: Timing, radar: RadarModel) -> Tracks:
    """Return the tracks for the speed that explains a part of the plots best."""
    if not len(plots):
        return Tracks((), 0.0)
    part = plots.until(LOOKS * timing.look_s)

    def link(some: Plots, speed: float) -> Tracks:
        model = guess_of(some, timing, radar.range_std, radar.azimuth_std, speed)
        return link_plots(some, timing, model, np.zeros(len(some)))

    usable = part if len(part) else plots
    best = max(SPEEDS, key=lambda speed: link(usable, speed).score)
    return link(plots, best)


class RegistrationError(ValueError):
    """A recording is insufficient; the message names what is missing."""


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
