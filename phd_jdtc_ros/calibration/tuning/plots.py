"""One sensor's recorded detections as columns, ordered by time, and the times of its looks.

The antenna's rotation is estimated from azimuths and times of detections.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from phd_jdtc_ros.calibration import kinematics
from phd_jdtc_ros.configuration.parameters.radar import MOST_SECTORS
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.intake.antenna import MIN_PERIOD_S, Antenna, AntennaTrack
from phd_jdtc_ros.core.intake.input_checks import (
    COPIED_DETECTIONS,
    REPEATED,
    NearCopies,
    PositionReportCheck,
    is_copy,
)
from phd_jdtc_ros.core.intake.sectors import smallest_arc
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.sensors.polar_geometry import to_plane
from phd_jdtc_ros.core.types import FULL_TURN, Detections

# More plots take longer and hardly sharpen the estimates, but targets are found in several clouds.
MOST_PLOTS, LEAST_CLOUDS = 15_000, 10
# If LEAST_CLOUDS have more, targets are distinct from such clutter only in more clouds: in a sector
# of DENSE_CLOUDS. SECTORS bounds how many sectors are tried.
DENSE_CLOUDS, SECTORS = 20, 3


@dataclass(frozen=True)
class Plots:
    """All detections of one radar."""

    zero_ns: int  # The first stamp
    cloud_s: FloatArray  # Stamps of the clouds, ascending, seconds after the first, (K,)
    cloud: IntArray  # The cloud of each detection, (N,)
    time_s: FloatArray  # Time of each detection, ascending, seconds after the first stamp, (N,)
    # Range and azimuth, metres and radians counter-clockwise from the radar's x axis, (N, 2); or x
    # and y in the sensor's frame, metres, if these are `places`.
    measurement: FloatArray
    amplitude: FloatArray | None  # Linear envelopes, (N,); NaN where unknown
    # Position, metres, and yaw, radians, of the radar at each detection, (N, 3); zeros if it does
    # not move.
    pose: FloatArray
    timed: bool  # True if the detections of a cloud have times of their own
    # Configured bounds of the field of view: width, radians, and least range, metres.
    fov: float = FULL_TURN
    min_range: float = 0.0
    places: bool = False  # Whether these are positions
    # Measured velocities in the frame of the poses, (N, 2), or range rates, (N, 1), metres per
    # second; NaN where unknown. None without any.
    velocity: FloatArray | None = None
    # Elevations, radians, of a radar in space, whose ranges are slant ranges, (N,); NaN where
    # unknown. None without any.
    elevation: FloatArray | None = None
    # Ground range over slant range, (N,); None if both are equal.
    level: FloatArray | None = None
    ambiguity: float = 0.0  # Interval modulo which range rates are known, m/s; 0 without any

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last stamp, seconds."""
        return float(self.cloud_s[-1]) if len(self.cloud_s) else 0.0

    @property
    def position(self) -> FloatArray:
        """Positions in the frame of the poses, metres, shape (N, 2)."""
        return kinematics.positions(self.measurement, self.pose, self.places)

    @property
    def travelled(self) -> FloatArray:
        """What changes with `velocity`: positions, (N, 2), or slant ranges, (N, 1), metres."""
        if self.places:
            return self.position
        # A ground range near the zenith does not show the slant range.
        level = 1.0 if self.level is None else np.maximum(self.level, 0.1)
        slant: FloatArray = self.measurement[:, :1] / np.reshape(level, (-1, 1))
        return slant

    @property
    def bearing(self) -> FloatArray:
        """Directions from the sensor, radians from the x axis of the poses' frame, (N,)."""
        x, y = self.measurement.T
        bearing: FloatArray = (np.arctan2(y, x) if self.places else y) + self.pose[:, 2]
        return bearing

    def across(self, azimuth_std: float, rows: IntArray) -> float:
        """Return the second standard deviation of plots at their median range, metres."""
        return azimuth_std * (1.0 if self.places else float(np.median(self.measurement[rows, 0])))

    def until(self, time_s: float) -> Plots:
        """Return the plots of the clouds up to a time, seconds after the first stamp."""
        clouds = int(np.searchsorted(self.cloud_s, time_s, side="right"))
        part = self.only(np.flatnonzero(self.cloud < clouds))
        return replace(part, cloud_s=self.cloud_s[:clouds])

    def only(self, rows: IntArray) -> Plots:
        """Return the plots of these rows, ascending, and all clouds."""
        return replace(
            self,
            cloud=self.cloud[rows],
            time_s=self.time_s[rows],
            measurement=self.measurement[rows],
            amplitude=None if self.amplitude is None else self.amplitude[rows],
            pose=self.pose[rows],
            velocity=None if self.velocity is None else self.velocity[rows],
            elevation=None if self.elevation is None else self.elevation[rows],
            level=None if self.level is None else self.level[rows],
        )


def limit_plots(plots: Plots, most: int = MOST_PLOTS) -> Plots:
    """Return the plots of the first clouds: about `most` of them.

    If `LEAST_CLOUDS` clouds have more, the plots are those of `DENSE_CLOUDS`.
    """
    if len(plots) <= most:
        return plots
    last = int(plots.cloud[most])
    if _dense(plots, most):
        last = min(DENSE_CLOUDS, len(plots.cloud_s)) - 1
    return plots.until(float(plots.cloud_s[last]))


def sectors(plots: Plots, most: int = MOST_PLOTS) -> Iterator[tuple[Plots, IntArray]]:
    """Yield sectors of a radar's coverage with about `most` plots each, and their plots' indices.

    The work of linking grows with the square of the plots in a cloud. The widest sectors come
    first, because targets are the most distinct where clutter is sparse. Unless `LEAST_CLOUDS`
    clouds have more than `most` plots, there is one sector: all plots.
    """
    if not _dense(plots, most):
        yield plots, np.arange(len(plots))
        return
    bearing = plots.bearing
    start, _ = smallest_arc(bearing)
    along = (bearing - start) % FULL_TURN
    parts = np.array_split(np.argsort(along, kind="stable"), -(-len(plots) // most))
    widths = [float(np.ptp(along[part])) for part in parts]
    for index in np.argsort(widths)[::-1][:SECTORS]:
        rows = np.sort(parts[index])
        yield replace(plots.only(rows), fov=min(plots.fov, widths[index])), rows


def _dense(plots: Plots, most: int) -> bool:
    """Return whether `LEAST_CLOUDS` clouds have more than `most` plots."""
    return len(plots) > most and int(plots.cloud[most]) < LEAST_CLOUDS - 1


def plots_of(
    reports: Sequence[tuple[int, Detections]], places: bool = False, ambiguity: float = 0.0
) -> Plots:
    """Return the detections of a sensor's reports with their stamps, ns, in any order.

    Those that repeat the one before are left out, because their errors are not independent.
    `places` tells whether they are positions; for `ambiguity` see `Plots`.
    """
    ordered = _without_copies(sorted(reports, key=lambda report: report[0]), places)
    zero_ns = ordered[0][0]
    cloud_s = np.array([(stamp_ns - zero_ns) * 1e-9 for stamp_ns, _ in ordered])
    sizes = [len(found) for _, found in ordered]
    cloud = np.repeat(np.arange(len(ordered)), sizes)
    # The times of single detections are their own too.
    most = max(sizes)
    timed = any(
        len(found) and found.time_s is not None and (most == 1 or np.ptp(found.time_s) > 0.0)
        for _, found in ordered
    )
    offset = np.concatenate(
        [np.zeros(len(found)) if found.time_s is None else found.time_s for _, found in ordered]
    )
    time_s = cloud_s[cloud] + offset
    order = np.argsort(time_s, kind="stable")
    amplitude = None
    if any(found.amplitude is not None for _, found in ordered):
        amplitude = _column(ordered, "amplitude", np.nan)[order]
    pose = np.concatenate([_poses(found) for _, found in ordered])[order]
    velocity = level = None
    if not places and any(found.range_rate is not None for _, found in ordered):
        velocity = _column(ordered, "range_rate", np.nan)[order, None]
    if any(found.level is not None for _, found in ordered):
        level = np.nan_to_num(_column(ordered, "level", 1.0)[order], nan=1.0)
    if places and any(found.velocity is not None for _, found in ordered):
        nothing = [np.full((len(found), 2), np.nan) for _, found in ordered]
        own = [found.velocity for _, found in ordered]
        known = [none if each is None else each for none, each in zip(nothing, own, strict=True)]
        turn = pose * [0.0, 0.0, 1.0]
        velocity = kinematics.positions(np.concatenate(known)[order], turn, places)
    measured = np.concatenate([found.measurement for _, found in ordered])[order]
    return Plots(
        zero_ns=zero_ns,
        cloud_s=cloud_s,
        cloud=cloud[order],
        time_s=time_s[order],
        measurement=np.ascontiguousarray(measured[:, :2]),
        amplitude=amplitude,
        pose=pose,
        timed=timed,
        places=places,
        velocity=velocity,
        elevation=_elevations([found for _, found in ordered], measured, order),
        level=level,
        ambiguity=ambiguity,
    )


def _column(reports: Sequence[tuple[int, Detections]], quantity: str, unknown: float) -> FloatArray:
    """Return a quantity of all detections, in the order of the reports, (N,)."""
    found = [(len(each), getattr(each, quantity)) for _, each in reports]
    return np.concatenate(
        [np.full(size, unknown) if own is None else own for size, own in found], dtype=np.float64
    )


def _elevations(
    reports: Sequence[Detections], measured: FloatArray, order: IntArray
) -> FloatArray | None:
    """Return the elevations of ordered detections, (N,), NaN where unknown; None without any."""
    if measured.shape[1] < 3:
        return None
    nothing = [np.full(found.measurement.shape, np.nan) for found in reports]
    own = [found.noise_std for found in reports]
    std = [none if each is None else each for none, each in zip(nothing, own, strict=True)]
    unknown = np.concatenate(std)[order, 2] >= UNKNOWN_STD
    return None if unknown.all() else np.where(unknown, np.nan, measured[:, 2])


def _without_copies(
    reports: list[tuple[int, Detections]], places: bool
) -> list[tuple[int, Detections]]:
    """Return reports without those that repeat the one before, if chance does not explain these."""
    check = NearCopies()
    places_of = [
        found.measurement if places else to_plane(found.measurement, (0.0, 0.0), 0.0)
        for _, found in reports
    ]
    near = [check.add(place) for place in places_of]
    if check.sure:
        return [report for report, is_near in zip(reports, near, strict=True) if not is_near]
    if places:
        check_of_places = PositionReportCheck()
        noticed = [(report, check_of_places.add(report[1])) for report in reports]
        return [report for report, findings in noticed if REPEATED not in findings]
    copies = {
        number
        for number, ((first_ns, before), (ns, found)) in enumerate(pairwise(reports), 1)
        if ns > first_ns and is_copy(found, before)
    }
    if max((len(reports[number][1]) for number in copies), default=0) < COPIED_DETECTIONS:
        return reports
    return [report for number, report in enumerate(reports) if number not in copies]


def _poses(found: Detections) -> FloatArray:
    """Return the radar's pose at each of a report's detections, shape (M, 3)."""
    if found.pose is None:
        return np.zeros((len(found), 3))
    return np.tile([*found.pose.position, found.pose.yaw], (len(found), 1))


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
