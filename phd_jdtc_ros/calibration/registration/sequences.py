"""Plots of common targets by all radars, sorted by time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.bias import SensorBias

from ..tuning.plots import PlotSequences, pad_rows
from .common import Target
from .tracked_radars import TrackedRadar


@dataclass(frozen=True)
class Sequences(PlotSequences):
    """The plots of targets by all radars, with known biases removed; see `PlotSequences`."""

    radar: IntArray  # Radar of each plot, (K, T)
    plot: IntArray  # Index among the plots of its radar, (K, T)
    position: FloatArray  # Measured position, world frame, metres, (K, T, 2)
    noise_std: FloatArray  # Metres and radians, (K, T, 2)


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
    (radar, valid), (plot, _) = pad_rows(radar_rows), pad_rows(plot_rows)

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
