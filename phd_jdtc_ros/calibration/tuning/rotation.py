"""The antenna's rotation, estimated from azimuths and times of detections."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.configuration.parameters.radar import MOST_SECTORS
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.intake.antenna import MIN_PERIOD_S, Antenna, AntennaTrack
from phd_jdtc_ros.core.intake.sectors import smallest_arc
from phd_jdtc_ros.core.types import FULL_TURN

from .plots import Plots

# The antenna is followed in steps of at least `PLOTS` plots and `PERIOD_S` seconds.
PLOTS, PERIOD_S = 12, 1.0


@dataclass(frozen=True)
class Timing:
    """The times of a radar's looks."""

    # Median time between clouds, seconds; without a rotation, between looks.
    cloud_interval_s: float
    rotation_s: float = 0.0  # Rotation period; 0 if no rotation is observable in the plots
    rotation_std_s: float = 0.0  # Standard error of the mean rotation period, seconds
    sectors: int = 0  # Number of clouds per revolution; 0 if a cloud is a whole revolution
    clockwise: bool = False  # True if the antenna turns clockwise
    timed: bool = False  # True if each plot has its own time, so that clouds may have any length

    @property
    def look_s(self) -> float:
        """Time between two looks at a target, seconds."""
        return self.rotation_s or self.cloud_interval_s

    def looks(self, seconds: FloatArray, clouds: FloatArray) -> FloatArray:
        """Return the number of looks in times, given also in clouds; a part counts as a part."""
        return seconds / self.rotation_s if self.rotation_s else clouds


def timing_of(plots: Plots) -> Timing:
    """Return the times of a radar's looks, given plots of at least two clouds."""
    interval_s = float(np.median(np.diff(plots.cloud_s)))
    still = Timing(_look_interval_s(plots.cloud_s))
    if interval_s <= 0.0 or plots.places:
        return still
    clouds = _by_cloud(plots)
    azimuth = plots.measurement[:, 1] + plots.pose[:, 2]
    # Plots without individual times are located only to a cloud's sector, which suffices for
    # revolutions of two clouds or more.
    revolutions = PlotRevolutions(max(MIN_PERIOD_S, interval_s * (0.8 if plots.timed else 1.9)))
    if not plots.timed:
        for rows in clouds:
            start, width = smallest_arc(azimuth[rows])
            azimuth[rows] = start + 0.5 * width
    for time_s, own in zip(plots.time_s, azimuth, strict=True):
        revolutions.add(float(own), round(time_s * 1e9))
    revolutions.find()
    # The antenna counts as turning if it was followed for at least this share of the recording.
    if revolutions.counted_s < 0.25 * plots.duration_s:
        return still
    sectors = round(revolutions.revolution_s / interval_s)
    narrow = 1.5 * FULL_TURN / max(sectors, 1)
    widths = [smallest_arc(plots.measurement[rows, 1])[1] for rows in clouds if len(rows) > 1]
    is_sector = 1 < sectors <= MOST_SECTORS and (not widths or float(np.median(widths)) < narrow)
    return Timing(
        interval_s,
        revolutions.revolution_s,
        revolutions.revolution_std_s,
        sectors if is_sector else 0,
        revolutions.clockwise,
        plots.timed,
    )


def _look_interval_s(cloud_s: FloatArray) -> float:
    """Return the median time between looks, each of one cloud or of some in quick succession."""
    gap = np.diff(cloud_s)
    # A cloud belongs to the same look as the one before if it follows within this share of the
    # usual gap, which is the upper quartile.
    begins = gap > 0.2 * np.quantile(gap, 0.75)
    first = cloud_s[np.append(True, begins)]
    return float(np.median(np.diff(first))) if len(first) > 1 else 0.0


def _by_cloud(plots: Plots) -> list[IntArray]:
    order = np.argsort(plots.cloud, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(plots.cloud[order])) + 1) if len(plots) else []


class PlotRevolutions:
    """Follows the antenna as the tracker does, and estimates its mean rotation period.

    The shortest rotation period is `shortest_s`, seconds.
    """

    def __init__(self, shortest_s: float = MIN_PERIOD_S) -> None:
        self._shortest_s = shortest_s
        self._track = AntennaTrack(0.0)
        self._waiting: list[tuple[float, float]] = []
        self._before: tuple[float, Antenna] | None = None
        # Sums over the counted steps: number, time, angle, and squared angle divided by time.
        self._counted = np.zeros(4)

    @property
    def revolution_s(self) -> float:
        """Mean rotation period, seconds; 0 if unknown."""
        _, passed_s, turned, _ = self._counted
        if turned < FULL_TURN:
            return self._track.period_s
        return float(FULL_TURN * passed_s / turned)

    @property
    def revolution_std_s(self) -> float:
        """Standard error of `revolution_s` by the scatter of the steps, s; infinite below two."""
        count, passed_s, turned, squares = self._counted
        if count < 2:
            return math.inf
        variance = max(squares * passed_s / turned**2 - 1.0, 0.0) / (count - 1)
        return self.revolution_s * math.sqrt(variance)

    @property
    def counted_s(self) -> float:
        """Time over which revolutions have been counted, seconds."""
        return float(self._counted[1])

    @property
    def clockwise(self) -> bool:
        """Whether azimuths decrease, by the present estimate."""
        return self._before is not None and self._before[1].rate < 0.0

    def add(self, azimuth: float, time_ns: int) -> None:
        """Add a plot's azimuth, radians, and its time."""
        time_s = time_ns * 1e-9
        # Limit on plots per step; no radar has more in that time.
        if len(self._waiting) < 1000:  # Bounds the memory in a flood of plots
            self._waiting.append((time_s, azimuth))
        past_s = time_s - self._waiting[0][0]
        if len(self._waiting) >= PLOTS and abs(past_s) >= PERIOD_S:
            self.find()

    def begin_again(self) -> None:
        """Drop the plots after a jump back in time, and keep the rotation."""
        self._track, self._before = AntennaTrack(self.revolution_s), None
        self._waiting.clear()

    def find(self) -> None:
        """Follow the antenna up to the latest plot."""
        if not self._waiting:
            return
        time_s, azimuth = np.array(self._waiting).T
        self._waiting.clear()
        now_s, before = float(np.median(time_s)), self._before
        self._track = self._track.follow(now_s, time_s, azimuth, self._shortest_s)
        line = self._track.antenna
        self._before = None if line is None else (now_s, line)
        if line is None:
            return
        # If a revolution differs from the mean by more than this share, the antenna has changed its
        # speed.
        if self.counted_s and abs(line.period_s / self.revolution_s - 1.0) > 0.1:
            self._counted = np.zeros(4)
        elif before is not None:
            self._count(now_s, line, *before)

    def _count(self, now_s: float, line: Antenna, before_s: float, before: Antenna) -> None:
        """Count the angle turned since the last step."""
        passed_s = now_s - before_s
        # The number of revolutions in a longer gap is ambiguous.
        if not 0.0 < passed_s < 3.0 * before.period_s:
            return
        due = before.rate * passed_s
        turned = line.azimuth_at(now_s) - before.azimuth_at(before_s)
        turned = abs(due + math.remainder(turned - due, FULL_TURN))
        self._counted += 1.0, passed_s, turned, turned**2 / passed_s
