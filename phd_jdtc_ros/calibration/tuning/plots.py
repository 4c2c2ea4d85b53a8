"""One sensor's recorded detections as columns, ordered by time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from phd_jdtc_ros.calibration import kinematics
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
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
        # Smallest cosine of an elevation by which a ground range is divided
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
