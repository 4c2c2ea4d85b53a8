"""One radar of a registration: its noise, and its plots linked to tracks.

A receiver of self-reports takes part as a radar without bias, so far away that its errors are the
same in all directions; its tracks are those of the addresses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from phd_jdtc_ros.calibration import kinematics
from phd_jdtc_ros.calibration.tuning.tracks import Tracks, link_plots
from phd_jdtc_ros.core.arrays import FloatArray, IntArray, wrap_angle
from phd_jdtc_ros.core.sensors.bias import SensorBias
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import UNKNOWN, SelfReports

from ..tuning.plots import Plots
from ..tuning.rotation import Timing
from ..tuning.start import guess_of

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
