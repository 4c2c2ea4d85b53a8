"""Checks reports and results for signs of a wrong configuration.

They reject nothing; each finding becomes a warning with its likely cause. The pipeline leaves out
a report that is a copy of the one before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, wrap_angle, zeros_field
from ..engine import Step
from ..sensors.polar_geometry import to_plane
from ..sensors.sensor import Sensor
from ..types import FULL_TURN, Detections, Scan
from .sectors import smallest_arc

# Number of azimuth cells per revolution.
CELLS = 72
# Number of consecutive reports that can show sectors.
SECTOR_REPORTS = 60
# Smallest number of reports that can show a limited field of view.
FIELD_REPORTS = 50
# Smallest number of detections in all these reports.
FIELD_DETECTIONS = 200
# Smallest number of detections in a report that shows that a radar's reports come several times.
# Fewer can repeat by chance where measurements are coarse and targets rest.
COPIED_DETECTIONS = 5
# Finding: a report is a copy of the one before, and no new look.
REPEATED = "reports_repeated"
# Finding: a place that stands for an unknown one, such as -999 in both coordinates, comes again.
CONSTANT = "positions_constant"
# Finding: reports cover a part of the revolution each, and no sectors are configured.
NO_SECTORS = "sectors_not_configured"
# Finding: a report is nearly a copy of the one before, with other rounding or a little noise.
NEARLY_REPEATED = "reports_nearly_repeated"
# No detection of a near copy is farther from those of the report before than this share of what
# their median was in one of the two before. At least this share of the reports are near copies,
# of at least so many that can be compared.
NEAR, COPIES, LEAST_COMPARED = 0.1, 0.3, 20
# Number of reports that are compared, and of those from which they are the first: it takes time.
COMPARED, COMPARED_OF = 100, 1000
# The findings that contradict what no recording shows; the others contradict what it does.
NOT_IN_RECORDINGS = (
    *("azimuths_in_radians", "azimuths_in_turns"),
    *(CONSTANT, REPEATED, NEARLY_REPEATED),
)
# A revolution in radians, if it is taken for degrees.
RADIANS_AS_DEGREES = math.radians(FULL_TURN)
# Part of an azimuth's unit within which the first and the last one are of a revolution in turns.
TURN_MARGIN = 0.03
# A radar with a longer rotation period, seconds, and a longer range, metres, is for aircraft, whose
# height matters.
SLOW_REVOLUTION = 3.0
FAR = 40e3
# Number of scans with detections, and of nominal intervals, within which targets are expected.
PATIENCE = 30


# Finding: many detections have another one of their report within their noise.
TWINS = "detections_twinned"
# Number of detections, in reports of two or more, after which they are judged, and of those that
# are not compared after a judgement without twins, which takes time.
JUDGED, PASSED = 200, 2000
# Detections are twins if the difference of each component is smaller than its standard deviation.
# Others up to twice as far apart show how many are there by chance, or side by side.
REACH = 1.0
# The least number of twins, as a share of the detections, and in standard deviations from chance.
SHARE, SURE_SIGMA = 0.1, 4.0


@dataclass
class NearCopies:
    """Finds the reports whose detections are all near those of the report before."""

    compared: int = field(init=False, default=0)
    copies: int = field(init=False, default=0)
    _before: FloatArray = zeros_field(0, 2)  # Positions of the previous report, metres
    _distances: tuple[float, float] = field(init=False, default=(0.0, 0.0))

    def add(self, place: FloatArray) -> bool:
        """Return whether a report, of detections at these places, is nearly a copy of the last."""
        before, self._before = self._before, place
        if not len(place) or not len(before):
            return False
        apart = np.sort(_tree(before).query(place)[0])
        # Coarse measurements of targets at rest are often equal.
        near = len(place) == len(before) and 0.0 < apart[-1] < NEAR * max(self._distances)
        # Single false detections are far from those before.
        self._distances = self._distances[1], float(apart[(len(apart) - 1) // 2])
        self.compared += 1
        self.copies += near
        return near

    @property
    def sure(self) -> bool:
        """Whether chance does not explain the near copies."""
        return self.compared >= LEAST_COMPARED and self.copies >= COPIES * self.compared


@dataclass
class Rounding:
    """Finds positions that are rounded, so that those of targets at rest repeat exactly."""

    # Step that rounded coordinates have, metres, and the largest share of it that they are off by.
    step: float = 0.01
    tolerance: float = 1e-3
    repeats: int = field(init=False, default=0)  # Of positions, in reports that are no copies

    def note(self, place: FloatArray, before: FloatArray) -> None:
        """Note the positions, (M, 2), that a report has in common with the one before."""
        if self.repeats < COPIED_DETECTIONS:
            self.repeats += int(np.isin(place[:, 0], before[:, 0]).sum())

    def explains(self, place: FloatArray) -> bool:
        """Return whether a report of such positions may repeat the one before by itself."""
        steps = place / self.step
        whole = bool((np.abs(steps - np.rint(steps)) < self.tolerance).all())
        return whole or self.repeats >= COPIED_DETECTIONS


@dataclass
class TwinCheck:
    """Counts pairs of detections of one sensor that are nearer than two targets would stay."""

    _detections: int = field(init=False, default=0)
    _near: int = field(init=False, default=0)
    _around: int = field(init=False, default=0)
    _to_pass: int = field(init=False, default=0)

    def add(self, found: Detections, sensor: Sensor) -> int:
        """Return the number of twins since the last judgement if they are many, otherwise 0.

        The detections of the report must not have been merged.
        """
        if len(found) < 2 or sensor.cluster_distance:
            return 0
        if self._to_pass > 0:
            self._to_pass -= len(found)
            return 0
        # A difference has twice the variance of one detection.
        std = np.sqrt(2.0) * np.median(sensor.noise_std_of(found), axis=0)
        tree = _tree(found.measurement / std)
        reach = [REACH, 2.0 * REACH]
        near, around = (tree.count_neighbors(tree, reach, p=np.inf) - len(found)) // 2
        self._detections += len(found)
        self._near += int(near)
        self._around += int(around)
        if self._detections < JUDGED:
            return 0
        # In two components the outer area is three times as large as the inner one.
        by_chance = (self._around - self._near) / 3.0
        pairs = self._near - by_chance
        many = 2.0 * pairs > SHARE * self._detections
        sure = pairs > SURE_SIGMA * np.sqrt(self._near + by_chance / 3.0)
        found_twins = min(round(2.0 * pairs), self._detections) if many and sure else 0
        self._to_pass = 0 if found_twins else PASSED
        self._detections = self._near = self._around = 0
        return found_twins


@dataclass
class ReportCheck:
    """Checks the reports of one sensor for copies of the one before."""

    polar: ClassVar[bool] = False  # Whether measurements are ranges and azimuths, and not positions
    _before: Detections | None = field(init=False, default=None)  # The previous report
    _copied: bool = field(init=False, default=False)  # True once a report is clearly a copy
    _near_copies: NearCopies = field(init=False, default_factory=NearCopies)
    _added: int = field(init=False, default=0)  # Number of reports

    def add(self, detections: Detections) -> list[str]:
        """Return the names of the findings in a report: `REPEATED` or `NEARLY_REPEATED`."""
        noticed, before = list[str](), self._before
        if before is not None and is_copy(detections, before) and self._shows_copy(detections):
            self._copied |= len(detections) >= COPIED_DETECTIONS
            noticed += [REPEATED] if self._copied else []
        elif self._is_compared():
            place = detections.measurement
            place = to_plane(place, (0.0, 0.0), 0.0) if self.polar else place
            near = self._near_copies.add(place) and self._near_copies.sure
            noticed += [NEARLY_REPEATED] if near else []
        self._before = detections
        self._added += 1
        return noticed

    def used(self, detections: Detections) -> Detections:
        """Return the detections of a report without those of unknown places, once these show."""
        return detections

    def _shows_copy(self, detections: Detections) -> bool:
        """Return whether a report that repeats the one before shows that it is a copy."""
        return True

    def _is_compared(self) -> bool:
        """Return whether the next report is compared with the one before for near copies."""
        return self._near_copies.sure or self._added % COMPARED_OF < COMPARED


@dataclass
class PositionReportCheck(ReportCheck):
    """Checks the reports of a sensor of positions, which may be rounded."""

    _rounding: Rounding = field(init=False, default_factory=Rounding)

    # Points with coordinates of one size: the last ones, and those that stand for unknown places.
    _alike: FloatArray = zeros_field(0, 2)
    _unknown: FloatArray = zeros_field(0, 2)
    # How many others have been compared with those of the report before, and were equal to one.
    _others: int = field(init=False, default=0)
    _equal: int = field(init=False, default=0)

    def add(self, detections: Detections) -> list[str]:
        """Return the names of the findings in a report: also `CONSTANT`.

        No target is measured again at exactly one place whose x and y are of one size, such as -999
        or 0 in both, where none of the others is measured at its place again.
        """
        place, noticed = detections.measurement, list[str]()
        if self._before is not None and not is_copy(detections, self._before):
            self._rounding.note(place, self._before.measurement)
        alike = np.abs(place[:, 0]) == np.abs(place[:, 1])
        if self._before is not None and self._others - self._equal < COPIED_DETECTIONS:
            self._others += int(np.count_nonzero(~alike))
            self._equal += int(_among(place[~alike], self._before.measurement).sum())
        if True in alike:
            again = _among(place[alike], self._alike)
            self._alike, self._unknown = place[alike], place[alike][again]
            noticed += [CONSTANT] if True in again else []
        return noticed + super().add(detections)

    def used(self, detections: Detections) -> Detections:
        """Return the detections of a report without those of unknown places."""
        if self._equal or self._others < COPIED_DETECTIONS:
            return detections
        return detections.take(np.flatnonzero(~_among(detections.measurement, self._unknown)))

    def _shows_copy(self, detections: Detections) -> bool:
        """Return whether rounding does not explain that a report repeats the one before."""
        return not self._rounding.explains(detections.measurement)


@dataclass
class RadarReportCheck(ReportCheck):
    """Checks the reports of one polar radar."""

    polar: ClassVar[bool] = True
    reports_sectors: bool = True  # Whether the radar is configured to report by sectors
    sees_whole_turn: bool = False  # Whether it is configured to see all azimuths at once
    # True if its ground ranges are unknown although it is probably a radar for aircraft.
    lacks_ground_ranges: bool = False
    # Azimuth's unit, radians, of a radar that is configured to see many directions; 0 for others.
    unit: float = 0.0
    zero: float = 0.0  # Where its azimuths begin, radians from the x axis
    # Range below which not all detections of the radar can be, metres.
    near: float = 0.0
    _reports: int = field(init=False, default=0)
    _detections: int = field(init=False, default=0)
    _all: BoolArray = zeros_field(CELLS, dtype=np.bool_)
    _sectors: int = field(init=False, default=0)
    _together: BoolArray = zeros_field(CELLS, dtype=np.bool_)
    # Measurements of the first reports; None once their extent is checked.
    _first: list[FloatArray] | None = field(init=False, default_factory=list)

    def add(self, detections: Detections) -> list[str]:
        """Return the names of the findings in a report.

        They are those of `ReportCheck`, ``sectors_not_configured``, and once
        ``fov_not_configured``, ``slant_ranges``, ``azimuths_in_radians``, ``azimuths_in_turns`` and
        ``ranges_near``.
        """
        noticed, measurement = super().add(detections), detections.measurement
        if self.lacks_ground_ranges and len(detections):
            self.lacks_ground_ranges = False
            noticed.append("slant_ranges")
        azimuth = measurement[:, 1]
        if (
            not self.reports_sectors
            # Fewer detections of a report show no sector.
            and azimuth.size >= 4
            and self._is_sector(azimuth)
        ):
            noticed.append(NO_SECTORS)
        if self.sees_whole_turn and self._is_field(azimuth):
            noticed.append("fov_not_configured")
        if self.near and self._first is not None:
            noticed += self._wrong_units(self._first, measurement)
        return noticed

    def _wrong_units(self, first: list[FloatArray], measurement: FloatArray) -> list[str]:
        """Return the findings about the extent of the first reports, polar; at most once."""
        first.append(measurement)
        # Smallest number of reports, with `FIELD_DETECTIONS` together, whose extent shows their
        # units.
        if len(first) < 20 or sum(map(len, first)) < FIELD_DETECTIONS:
            return []
        distance, azimuth = np.concatenate(first).T[:2]
        self._first = None
        noticed = ["ranges_near"] if distance.max() < self.near else []
        if 0.0 < self.unit < 1.0:
            share = smallest_arc(azimuth)[1] / RADIANS_AS_DEGREES
            noticed += ["azimuths_in_radians"] if 0.5 < share < 1.0 else []
        if self.unit and self._are_turns(azimuth):
            noticed.append("azimuths_in_turns")
        return noticed

    def _are_turns(self, azimuth: FloatArray) -> bool:
        """Return whether azimuths fill the first unit of their revolution, and nothing else."""
        share = wrap_angle(azimuth - self.zero) / self.unit
        first, last = sorted(np.abs([share.min(), share.max()]))
        one_way = bool(share.min() * share.max() >= 0.0)
        return one_way and first < TURN_MARGIN and 1.0 - TURN_MARGIN < last <= 1.0 + 1e-6

    def _is_sector(self, azimuth: FloatArray) -> bool:
        """Return whether this is the last of `SECTOR_REPORTS` consecutive reports of sectors."""
        start, width = smallest_arc(azimuth)
        # Largest arc of a report of a sector, in revolutions.
        if width < 0.5 * FULL_TURN:
            self._sectors += 1
            self._together[_cells(start + np.linspace(0.0, width, CELLS))] = True
            if self._sectors < SECTOR_REPORTS:
                return False
        # Smallest part of the revolution that these reports cover together.
        covered = self._sectors == SECTOR_REPORTS and self._together.mean() > 0.75
        self._sectors = 0
        self._together[:] = False
        return bool(covered)

    def _is_field(self, azimuth: FloatArray) -> bool:
        """Return whether all detections lie within a part of the revolution; true at most once."""
        self._reports += 1
        self._detections += len(azimuth)
        self._all[_cells(azimuth)] = True
        if self._reports < FIELD_REPORTS or self._detections < FIELD_DETECTIONS:
            return False
        self.sees_whole_turn = False
        seen = np.linspace(0.0, FULL_TURN, CELLS, endpoint=False)[self._all]
        # Largest arc of these detections, in revolutions.
        return smallest_arc(seen)[1] < 0.4 * FULL_TURN


def _among(measurement: FloatArray, others: FloatArray) -> BoolArray:
    """Return which measurements, (M, Z), are exactly one of others, (K, Z)."""
    known = {*map(tuple, others.tolist())}
    return np.array([tuple(row) in known for row in measurement.tolist()], dtype=np.bool_)


def is_copy(found: Detections, before: Detections) -> bool:
    """Return whether two reports, which are not empty, have equal measurements and amplitudes."""
    own, other = found.measurement, before.measurement
    if not own.size or own.shape != other.shape or (own != other).any():
        return False
    if found.amplitude is None or before.amplitude is None:
        return found.amplitude is before.amplitude
    return np.array_equal(found.amplitude, before.amplitude, equal_nan=True)


def _tree(place: FloatArray) -> Any:
    """Return a tree of places, (M, Z), for searches of neighbours."""
    # A tracker starts the sooner without.
    from scipy.spatial import cKDTree

    return cKDTree(place)


def _cells(azimuth: FloatArray) -> IntArray:
    """Return which of `CELLS` equal parts of a turn each azimuth, radians, is in."""
    cells: IntArray = (np.mod(azimuth, FULL_TURN) / FULL_TURN * CELLS).astype(int)
    return np.minimum(cells, CELLS - 1)


@dataclass
class ResultCheck:
    """Checks whether detections lead to targets."""

    interval_s: float  # The nominal interval, seconds
    # Number of scans with detections since the last one with a target.
    scans: int = field(init=False, default=0)
    _since_ns: int | None = field(init=False, default=None)

    def note_step(self, scan: Scan, step: Step) -> bool:
        """Return whether targets are overdue, once in `PATIENCE` intervals with detections."""
        if step.targets:
            self.scans, self._since_ns = 0, None
            return False
        if not step.filtered or not any(each is not None and len(each) for each in scan.detections):
            return False
        if self._since_ns is None or scan.stamp_ns < self._since_ns:
            self._since_ns = scan.stamp_ns
        self.scans += 1
        waited_s = (scan.stamp_ns - self._since_ns) * 1e-9
        if self.scans < PATIENCE or waited_s < (PATIENCE - 1) * self.interval_s * 0.99:
            return False
        self._since_ns = scan.stamp_ns
        return True
