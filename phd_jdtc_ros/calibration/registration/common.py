"""Finds the tracks of different radars that belong to one target, and sorts their plots by time.

Tracks are compared at common times. The nearest ones are joined first, and simultaneous tracks of
one radar never belong to one target.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.sensors.bias import SensorBias

from .tracked_radars import TrackedRadar

# Interval of the comparison in scans of the slowest radar, largest number of times, and least
# number of times that two tracks must share.
STEP_LOOKS, MOST_TIMES, LEAST_TIMES = 1.5, 1000, 4
# Largest expected biases before any is estimated: of ranges in standard deviations and as a share
# of the range, of azimuths in radians, and of times in seconds.
RANGE_STDS, RANGE_SHARE, AZIMUTH, TIME_S = 10.0, 0.01, np.radians(1.5), 1.5
# Largest mean distance of two tracks of one target once biases are estimated, in standard
# deviations of a plot.
NEAR_STDS = 2.0
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
        reach[row] = RANGE_STDS * range_std + (RANGE_SHARE + AZIMUTH) * distance + TIME_S * speed
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
        limit = NEAR_STDS * plot_std if known else np.hypot(one.reach[row], other.reach)
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
