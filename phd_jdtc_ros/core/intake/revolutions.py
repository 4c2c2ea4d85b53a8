"""Cuts the reports of a turning radar into slices, and determines the coverage of each slice.

A surveillance antenna takes some seconds for a revolution, and a target is missed only if the
antenna has passed it. A report covers the time since the previous one. If its detections have times
of their own, this time is cut into slices of some 1.5 s, and each detection belongs to the slice of
its time. The coverage of a slice follows from the antenna's motion (see `antenna`), or from the
sector's number if the report has one. If neither is known, no target counts as missed.

A detection's time is a measurement and is never changed. A detection whose time disagrees with its
azimuth, or comes after its slice has been processed, is counted and used as it is.

A radar that does not turn sees its whole field at once. Its reports are not cut, even if its
detections have times of their own, because no slice could show what was missed. A radar that may
turn is treated in the same way until its rotation period has been found, which takes about two
revolutions.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from ..arrays import FloatArray, median
from ..types import FULL_TURN, UNKNOWN_COVERAGE, Coverage, Detections
from .antenna import MIN_PERIOD_S, AntennaTrack
from .scans import Rejection
from .sectors import (
    RadarReport,
    Slice,
    UnstampedSlice,
    arc,
    coverage_of,
    cut,
    is_sector,
    slices_per_revolution,
    smallest_arc,
)


class ReportTiming(NamedTuple):
    """Timing of the latest reports of a radar, from which the next one's is predicted."""

    # One row for each report, oldest first, seconds, (K, 3): its stamp; the time of its first
    # detection after the previous report's stamp; and the time of its last detection after its own
    # stamp. NaN if the detections have no times.
    timings: FloatArray = np.zeros((0, 3))
    last_s: float = math.nan  # Stamp of the latest report, seconds; NaN before the first
    interval_s: float = 0.0  # Median interval between reports, seconds; 0 if unknown
    # True if reports come at regular intervals, so that a missing one was lost.
    regular: bool = True
    # End of a report's interval relative to its stamp, seconds; NaN if no detection had a time. No
    # report has a detection later than this, and no following one has an earlier detection.
    lead_s: float = math.nan

    def after(self, stamp_s: float, time_s: FloatArray, period_s: float) -> ReportTiming:
        """Return the timing after a new report.

        `time_s` has the times of its detections, (M,), empty without any; `period_s` is the
        rotation period.
        """
        timing = [stamp_s, math.nan, math.nan]
        if time_s.size:
            time_s = self._plausible_times(stamp_s, time_s, period_s)
            timing[1:] = time_s.min() - self.last_s, time_s.max() - stamp_s
        # Time for which reports are remembered, in revolutions.
        recent = self.timings[:, 0] > stamp_s - 4.0 * period_s
        # Smallest number of reports that are remembered.
        recent[-8:] = True
        timings = np.concatenate([self.timings[recent], [timing]])
        intervals = timings[1:, 0] - timings[:-1, 0]
        interval_s = median(intervals) if intervals.size else 0.0
        # A radar with fewer report intervals counts as regular.
        regular = intervals.size < 4 or (
            # Largest median relative deviation of the report intervals of a regular radar.
            median(np.abs(intervals / interval_s - 1.0)) < 0.15
        )
        lead_s = np.fmin(np.fmax.reduce(timings[:, 2]), np.fmin.reduce(timings[:, 1]))
        lead_s = self.lead_s if np.isnan(lead_s) else float(lead_s)
        return ReportTiming(timings, stamp_s, interval_s, regular, lead_s)

    def _plausible_times(self, stamp_s: float, time_s: FloatArray, period_s: float) -> FloatArray:
        """Return the times that are plausible for a report, without those off by a revolution.

        If most are elsewhere than expected, the radar has changed its way of reporting, and all
        are used.
        """
        if math.isnan(self.lead_s) or not self.interval_s:
            return time_s
        end_s, begin_s = stamp_s + self.lead_s, self.last_s + self.lead_s
        # Detections farther than this beyond the expected end of a report do not move it, in report
        # intervals and in revolutions.
        beyond_s = min(0.75 * self.interval_s, 0.06 * period_s)
        near = (time_s > begin_s - beyond_s) & (time_s < end_s + beyond_s)
        plausible = time_s[near]
        return plausible if 2 * plausible.size > time_s.size else time_s


class State(NamedTuple):
    """State of a run, from which the next report is cut."""

    track: AntennaTrack
    period_s: float  # Current estimate of the rotation period, seconds; 0 if unknown
    # The first estimate of the rotation period, seconds; 0 if there was none. It stays constant
    # while wind changes the antenna's speed.
    first_period_s: float = 0.0
    last_ns: int | None = None  # Stamp of the latest report
    slice_ns: int = 0  # Stamp of the latest slice
    # Timing of the reports, without those that repeated an earlier one.
    timing: ReportTiming = ReportTiming()
    end_s: float = math.nan  # End of the time that the reports cover, seconds; NaN if unknown
    end: float = math.nan  # Direction of the antenna at this time, radians; NaN if unknown
    number: int | None = None  # Number of the latest sector
    step: int = 0  # Difference of the numbers of successive sectors; 0 if unknown


@dataclass
class Revolutions:
    """Cuts the reports of one radar.

    `anomalies` counts irregular reports and detections: ``clouds_missing``, ``sectors_repeated``,
    ``sector_numbers_wrong``, ``antenna_unclear``, ``times_disagree`` and ``detections_late``.
    """

    # Directions of the antenna at the end of one report and at the start of the next are joined if
    # they differ by less than this, radians.
    MAX_EDGE_DIFFERENCE: ClassVar[float] = 0.3
    # Smallest number of detections whose azimuths show which part of the field a report covers,
    # while the antenna's motion is unknown.
    MIN_DETECTIONS: ClassVar[int] = 5
    # Such a report covers the whole field if its azimuths span more than this, radians.
    MIN_WHOLE_SPAN: ClassVar[float] = 0.75 * FULL_TURN
    # The antenna may be standing still if they span less than this, radians.
    MAX_STANDING_SPAN: ClassVar[float] = 0.25 * FULL_TURN
    # A detection is late if it precedes its report's interval by more than this share of a
    # revolution.
    MAX_LATENESS: ClassVar[float] = 0.0625
    # Longest coverage of one report in revolutions, even if the previous one was longer ago.
    MAX_COVERED_REVOLUTIONS: ClassVar[float] = 1.2
    # Smallest number of reports per revolution from whose stamps the antenna's motion is estimated.
    LEAST_REPORTS: ClassVar[float] = 1.9

    # Configured rotation period, seconds; 0 to find out whether the antenna turns.
    configured_period_s: float = 0.0
    sectors: int = 0  # Number of reports per revolution; 0 if it is unknown or varies
    compass: bool = False  # Whether sectors are numbered clockwise from north; see `sectors`
    # A stamp that is further behind the latest than this begins a new run.
    reset_threshold_s: float = math.inf
    fine: bool = False  # Whether slices are fine; see `slices.FEWEST_FINE`
    # Bias of the antenna's azimuths, radians counter-clockwise. Sector numbers refer to the biased
    # azimuths; those of the detections are corrected already.
    azimuth_bias: float = 0.0
    # Lower bound of an estimated rotation period, seconds; infinite to estimate none.
    min_period_s: float = MIN_PERIOD_S
    state: State = field(init=False)
    anomalies: Counter[str] = field(init=False, default_factory=Counter)

    def __post_init__(self) -> None:
        period_s = self.configured_period_s
        self.state = State(AntennaTrack(period_s), period_s)

    def reset(self) -> None:
        """Forget all reports, but keep the rotation period."""
        period_s = self.nominal_period_s
        self.state = State(AntennaTrack(period_s), period_s, self.state.first_period_s)

    @property
    def nominal_period_s(self) -> float:
        """Rotation period, configured or as first estimated, seconds; 0 if unknown."""
        return self.state.first_period_s or self.configured_period_s

    @property
    def period_s(self) -> float:
        """Current estimate of the rotation period, seconds; 0 if unknown."""
        return self.state.period_s

    @property
    def report_duration_s(self) -> float:
        """Length of time that a report covers, seconds; 0 if unknown."""
        if self.sectors:
            return self.period_s / self.sectors
        return min(self.state.timing.interval_s, self.period_s)

    @property
    def _per_revolution(self) -> int:
        """Number of reports per revolution; 1 if unknown."""
        return (
            max(round(self.period_s / self.report_duration_s), 1) if self.report_duration_s else 1
        )

    def is_behind(self, stamp_ns: int) -> bool:
        """Return whether a report is no newer than the latest of this run."""
        last_ns = self.state.last_ns
        if last_ns is None:
            return False
        return last_ns - self.reset_threshold_s * 1e9 <= stamp_ns <= last_ns

    def split(
        self, stamp_ns: int, detections: Detections, sector: int | None = None
    ) -> list[Slice] | Rejection:
        """Return the slices of a report, oldest first, each with its stamp and coverage.

        `time_s` is relative to the slice's stamp, and stamps increase over all reports. The
        coverage is None if the report covers the radar's whole field. A report of a part of a
        revolution that has been cut already is rejected. `sector` is the number of the sector, if
        the report has one.
        """
        sector = sector if self.sectors > 1 else None
        if self.is_behind(stamp_ns):
            return self._out_of_order(stamp_ns, detections, sector)
        if self.state.last_ns is not None and stamp_ns < self.state.last_ns:
            self.reset()
        report, unclear = RadarReport.of(stamp_ns, detections), self.state.track.unclear
        self._follow_antenna(report)
        if not self.nominal_period_s or (not report.timed and self._per_revolution == 1):
            self._remember(report, report.detection_s)
            self.state = self.state._replace(slice_ns=stamp_ns)
            return [(stamp_ns, detections)]
        self.anomalies["antenna_unclear"] += self.state.track.unclear > unclear
        due, previous_number = self._reports_due(report.stamp_s), self.state.number
        number = self._sector_number(report, sector, due)
        if (
            due < 0.5
            and self._per_revolution > 1
            and self._is_repeated(report, number, previous_number)
        ):
            self.anomalies["sectors_repeated"] += 1
            return self._stamp(report, [UnstampedSlice(stamp_ns, detections, UNKNOWN_COVERAGE)])
        start_s, end_s = self._covered_time(report, due)
        slices, end = self._slices(report, number, start_s, end_s)
        self.state = self.state._replace(end_s=end_s, end=end)
        return self._stamp(report, slices)

    def _out_of_order(
        self, stamp_ns: int, detections: Detections, sector: int | None
    ) -> list[Slice] | Rejection:
        """Return the slices of a report no newer than the latest; the state does not change."""
        if not self.nominal_period_s:
            return [(stamp_ns, detections)]
        if stamp_ns == self.state.last_ns:
            return Rejection.DUPLICATE
        if detections.time_s is not None:
            return Rejection.LATE
        # Without times it keeps its stamp, and its scan may still be open.
        coverage = UNKNOWN_COVERAGE if sector is None else self._coverage(sector)
        return [(stamp_ns, detections.changed(coverage=coverage))]

    def _follow_antenna(self, report: RadarReport) -> None:
        """Update the antenna's track by a report's detections."""
        previous_track, timing = self.state.track, self.state.timing
        track, timed = previous_track, not math.isnan(timing.lead_s)
        # Without times of detections, fewer reports per revolution do not show the motion.
        shortest_s = self.LEAST_REPORTS * (timing.interval_s or report.stamp_s - timing.last_s)
        if report.timed:
            # Detections' own times replace a track that was estimated from stamps.
            track = previous_track if timed else AntennaTrack(self.nominal_period_s)
            track = track.follow(
                report.stamp_s, report.detection_s, report.azimuth, self.min_period_s
            )
        elif not timed and not (self.sectors < 2 and 0.0 < self.nominal_period_s < shortest_s):
            azimuth, min_period_s = report.azimuth, float(np.fmax(shortest_s, self.min_period_s))
            if len(azimuth):
                # The antenna was somewhere in their arc at the stamp.
                start, width = smallest_arc(azimuth)
                azimuth = np.full(len(azimuth) if self.nominal_period_s else 1, start + 0.5 * width)
            time_s = np.full(len(azimuth), report.stamp_s)
            track = previous_track.follow(report.stamp_s, time_s, azimuth, min_period_s)
            if self.sectors > 1:
                # Stamps give the period more accurately than azimuths that are known by sector.
                track = track.with_period(self.sectors * timing.interval_s)
        period_s = track.period_s
        if period_s and not previous_track.period_s:
            self.state = self.state._replace(first_period_s=period_s)
        period_s = period_s or self.nominal_period_s
        self.state = self.state._replace(track=track, last_ns=report.stamp_ns, period_s=period_s)

    def _reports_due(self, stamp_s: float) -> float:
        """Return the number of reports due since the previous one, including this one."""
        timing, duration_s = self.state.timing, self.report_duration_s
        last_s = timing.last_s
        if math.isnan(last_s) or not duration_s or not timing.regular:
            return 1.0
        return (stamp_s - last_s) / duration_s

    def _sector_number(self, report: RadarReport, sector: int | None, due: float) -> int | None:
        """Return the sector's number: the reported one, or the next one for an empty report."""
        previous_number = self.state.number
        step = self.state.step
        antenna = self.state.track.antenna
        if antenna is not None:
            step = 1 if (antenna.rate > 0.0) != self.compass else -1
        if sector is None:
            if not len(report.detections) and previous_number is not None and step:
                sector = (previous_number + step * max(round(due), 1)) % self.sectors
        elif not is_sector(report.azimuth, self._coverage(sector)):
            self.anomalies["sector_numbers_wrong"] += 1
            sector = None
        elif previous_number is not None and self.sectors > 2:
            adjacent_steps = {1: 1, self.sectors - 1: -1}
            step = adjacent_steps.get((sector - previous_number) % self.sectors, step)
        self.state = self.state._replace(number=sector, step=step)
        return sector

    def _is_repeated(
        self, report: RadarReport, number: int | None, previous_number: int | None
    ) -> bool:
        """Return whether a report that comes too early repeats an earlier one."""
        if number is not None:
            return number == previous_number
        return not report.timed or bool(
            report.detection_s.max(initial=-math.inf) < self.state.end_s
        )

    def _coverage(self, sector: int) -> Coverage:
        """Return the coverage of a sector in true azimuths."""
        measured = coverage_of(sector, self.sectors, self.compass)
        start = math.remainder(measured.start - self.azimuth_bias, FULL_TURN)
        return Coverage(start, measured.width)

    def _remember(self, report: RadarReport, detection_s: FloatArray) -> None:
        """Update the timing by a report's stamp and its plausible detection times."""
        timing = self.state.timing.after(report.stamp_s, detection_s, self.state.period_s)
        self.state = self.state._replace(timing=timing)

    def _covered_time(self, report: RadarReport, due: float) -> tuple[float, float]:
        """Return the start and the end of the time that a report covers, seconds."""
        before_s, length_s, period_s = self.state.end_s, self.report_duration_s, self.state.period_s
        detection_s = report.detection_s
        if report.timed and (antenna := self.state.track.antenna) is not None:
            detection_s = detection_s[antenna.fits(detection_s, report.azimuth)]
            self.anomalies["times_disagree"] += report.detection_s.size - detection_s.size
        self._remember(report, detection_s)
        lead_s = self.state.timing.lead_s if report.timed else 0.5 * length_s
        lead_s = 0.0 if math.isnan(lead_s) else lead_s
        # No time is covered twice; for the first report `before_s` is NaN.
        end_s = float(np.fmax(report.stamp_s + lead_s, before_s))
        start_s = end_s - self.MAX_COVERED_REVOLUTIONS * period_s
        lost = round(due) >= 2
        if lost or math.isnan(before_s):
            # A detection from the gap shows that its part of the gap was not lost.
            start_s = max(start_s, min(end_s - length_s, detection_s.min(initial=math.inf)))
        start_s = float(np.fmax(start_s, before_s))
        if lost and not math.isnan(before_s):
            self.anomalies["clouds_missing"] += round((start_s - before_s) / length_s)
        late = detection_s < start_s - self.MAX_LATENESS * period_s
        self.anomalies["detections_late"] += detection_s[late].size
        return start_s, end_s

    def _slices(
        self, report: RadarReport, number: int | None, start_s: float, end_s: float
    ) -> tuple[list[UnstampedSlice], float]:
        """Return the slices of a report, and the antenna's direction at its end, radians or NaN."""
        stamp_ns, detections = report.stamp_ns, report.detections
        antenna = self.state.track.antenna
        sector = None if number is None else self._coverage(number)
        if antenna is None or (sector is not None and not report.timed):
            covered = self._unclear_coverage(report) if sector is None else sector
            return [UnstampedSlice(stamp_ns, detections, covered)], math.nan
        if sector is not None:
            # The number gives the azimuths, and the antenna's motion the times.
            half = math.copysign(0.5 * sector.width, antenna.rate)
            middle = sector.start + 0.5 * sector.width
            middle_s = antenna.time_near(middle, 0.5 * (start_s + end_s))
            start_s, end_s = middle_s - half / antenna.rate, middle_s + half / antenna.rate
            start, end = middle - half, middle + half
        else:
            start, end = antenna.azimuth_at(start_s), antenna.azimuth_at(end_s)
            if start_s == self.state.end_s and not math.isnan(self.state.end):
                # With joined edges, no azimuth between two reports is left out or covered twice.
                difference = math.remainder(start - self.state.end, FULL_TURN)
                start -= difference if abs(difference) < self.MAX_EDGE_DIFFERENCE else 0.0
            start = start if (end - start) * antenna.rate > 0.0 else end
        if not report.timed:
            return [UnstampedSlice(stamp_ns, detections, arc(start, end))], end
        period_s = self.state.period_s
        length_s = period_s / slices_per_revolution(period_s, self.fine)
        return cut(report, length_s, (start_s, end_s), (start, end)), end

    def _unclear_coverage(self, report: RadarReport) -> Coverage | None:
        """Return the coverage of a report while the antenna's motion is unknown."""
        is_enough = len(report.detections) >= self.MIN_DETECTIONS
        span = smallest_arc(report.azimuth)[1] if is_enough else 0.0
        may_stand = is_enough and span < self.MAX_STANDING_SPAN
        covers_field = span > self.MIN_WHOLE_SPAN or (self._per_revolution == 1 and not may_stand)
        return None if covers_field else UNKNOWN_COVERAGE

    def _stamp(self, report: RadarReport, unstamped: list[UnstampedSlice]) -> list[Slice]:
        """Return slices with strictly increasing stamps."""
        slices, stamp_ns = [], self.state.slice_ns
        for middle_ns, detections, coverage in unstamped:
            stamp_ns = max(middle_ns, stamp_ns + 1)
            time_s = detections.time_s
            if time_s is not None:
                time_s = time_s + (report.stamp_ns - stamp_ns) * 1e-9
            slices.append((stamp_ns, detections.changed(time_s=time_s, coverage=coverage)))
        self.state = self.state._replace(slice_ns=stamp_ns)
        return slices
