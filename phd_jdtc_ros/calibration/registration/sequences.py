"""Plots of common targets by all radars, sorted by time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.bias import RadarBias

from .common import Target
from .sensors import Sensor

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Sequences:
    """T targets of at most K plots; shorter ones are padded with their last plot.

    Parameters
    ----------
    there : bool array of shape (K, T)
        False for padding.
    radar : int array of shape (K, T)
        Radar of each plot.
    plot : int array of shape (K, T)
        Index among the plots of its radar.
    time_s : array of shape (K, T)
        Ascending, seconds.
    measurement : array of shape (K, T, 2)
        Known biases are removed.
    position : array of shape (K, T, 2)
        Measured position, world frame, metres.
    pose : array of shape (K, T, 3)
        Pose of the radar.
    noise_std : array of shape (K, T, 2)
    """

    there: BoolArray
    radar: IntArray
    plot: IntArray
    time_s: FloatArray
    measurement: FloatArray
    position: FloatArray
    pose: FloatArray
    noise_std: FloatArray


def sequences(
    sensors: Sequence[Sensor], biases: Sequence[RadarBias], targets: Sequence[Target]
) -> Sequences:
    """Return the plots of common targets with known biases removed."""
    corrected = [each.corrected(bias) for each, bias in zip(sensors, biases, strict=True)]
    rows = []
    for target in targets:
        radar = np.concatenate([np.full(len(_of(sensors, track)), track[0]) for track in target])
        plot = np.concatenate([_of(sensors, track) for track in target])
        time_s = np.array([corrected[r].time_s[p] for r, p in zip(radar, plot, strict=True)])
        order = np.argsort(time_s, kind="stable")
        rows.append((radar[order], plot[order]))
    longest = max(len(radar) for radar, _ in rows)
    count = np.array([len(radar) for radar, _ in rows])
    radar, plot = (
        np.array([np.append(row[k], np.full(longest - len(row[k]), row[k][-1])) for row in rows]).T
        for k in (0, 1)
    )

    def gather(columns: Sequence[FloatArray]) -> FloatArray:
        """Return the value of each plot in its radar's column."""
        found = np.zeros((*radar.shape, *columns[0].shape[1:]))
        for index, column in enumerate(columns):
            own = radar == index
            found[own] = column[plot[own]]
        return found

    return Sequences(
        np.arange(longest)[:, None] < count,
        radar,
        plot,
        gather([each.time_s for each in corrected]),
        gather([each.measurement for each in corrected]),
        gather([each.position for each in corrected]),
        gather([each.pose for each in sensors]),
        np.array([each.noise_std for each in sensors])[radar],
    )


def _of(sensors: Sequence[Sensor], track: tuple[int, int]) -> IntArray:
    """Return the plots of a track."""
    radar, row = track
    return sensors[radar].tracks[row]
