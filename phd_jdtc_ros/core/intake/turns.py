"""Cuts the reports of a turning radar into slices, and determines the coverage of each slice.

A surveillance antenna takes some seconds for a turn, and a target is missed only if the antenna has
passed it. A report covers the time since the previous one. If its detections have times of their
own, this time is cut into slices of about an eighth of a turn, and each detection belongs to the
slice of its time. The coverage of a slice follows from the antenna's motion (see `antenna`), or
from the sector's number if the report has one. If neither is known, no target counts as missed.

A detection's time is a measurement and is never changed. A detection whose time disagrees with its
azimuth, or comes after its slice has been processed, is counted and used as it is.

A radar that does not turn sees its whole field at once. Its reports are not cut, even if its
detections have times of their own, because no slice could show what was missed. A radar that may
turn is treated in the same way until its turn has been found, which takes about two turns.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..types import FULL_TURN, UNKNOWN_COVERAGE, Coverage, Detections
from .antenna import SHORTEST_S, AntennaTrack
from .horizon import Horizon
from .scans import Rejection
from .sectors import coverage_of, is_sector, smallest_arc

# Slices per turn; a target's motion during half a slice is nearly straight.
SLICES = 8
# Edges of successive reports are joined if the antenna's lines differ by less than this there, rad.
JOINED = 0.3
# While the antenna's motion is unknown, a report of at least LEAST_SHOWN detections covers the
# whole field if they span more than AROUND; if they span less than STANDING the antenna may stand.
LEAST_SHOWN, AROUND, STANDING = 5, 0.75 * FULL_TURN, 0.25 * FULL_TURN
# A detection is late if it precedes its report's interval by more than this share of a turn.
LATE = 0.5 / SLICES
# Longest coverage of one report in turns, even if the previous one was longer ago.
LONGEST = 1.2

Piece = tuple[int, Detections]
_Part = tuple[int, Detections, Coverage | None]


class State(NamedTuple):
    """State of a run, from which the next report is cut.

    Parameters
    ----------
    track : AntennaTrack
    found_s : float
        Estimated time of a turn when it was first found, seconds; 0 if it was not. It stays
        constant while wind changes the antenna's speed.
    last_ns : int or None
        Stamp of the latest report.
    piece_ns : int
        Stamp of the latest slice.
    horizon : Horizon
        Timing of the reports, without those that repeated an earlier one.
    end_s, end : float
        End of the time that the reports cover, seconds, and the antenna's direction then, radians;
        NaN if unknown.
    number : int or None
        Number of the latest sector.
    step : int
        Difference of the numbers of successive sectors; 0 if unknown.
    """

    track: AntennaTrack
    found_s: float = 0.0
    last_ns: int | None = None
    piece_ns: int = 0
    horizon: Horizon = Horizon()
    end_s: float = math.nan
    end: float = math.nan
    number: int | None = None
    step: int = 0


class _Report(NamedTuple):
    """A report, with its times in seconds."""

    stamp_ns: int
    detections: Detections

    @property
    def stamp_s(self) -> float:
        """Stamp of the report."""
        return self.stamp_ns * 1e-9

    @property
    def timed(self) -> bool:
        """Whether detections have times of their own."""
        return self.detections.time_s is not None

    @property
    def own_s(self) -> FloatArray:
        """Times of the detections, shape (M,); empty if they have none."""
        own_s = self.detections.time_s
        return np.zeros(0) if own_s is None else self.stamp_s + own_s

    @property
    def azimuth(self) -> FloatArray:
        """Azimuths of the detections, radians, shape (M,)."""
        azimuth: FloatArray = self.detections.measurement[:, 1]
        return azimuth


@dataclass
class Turns:
    """Cuts the reports of one radar.

    Parameters
    ----------
    rotation_s : float
        First guess of the time of a turn, seconds; 0 to find out whether the antenna turns.
    sectors : int
        Number of reports per turn; 0 if it is unknown or varies.
    compass : bool
        Whether sectors are numbered clockwise from north; see `sectors`.
    reset_threshold_s : float
        A stamp that is further behind the latest than this begins a new run.
    azimuth_bias : float
        Bias of the antenna's azimuths, which sectors' numbers refer to, radians counter-clockwise.
        The azimuths of the detections are corrected already.
    shortest_s : float
        Lower bound of an estimated turn, seconds; infinite to estimate none.

    Attributes
    ----------
    state : State
    doubts : Counter
        Counts of irregular reports and detections: ``clouds_missing``, ``sectors_repeated``,
        ``sector_numbers_wrong``, ``antenna_unclear``, ``times_disagree`` and ``detections_late``.
    """

    rotation_s: float = 0.0
    sectors: int = 0
    compass: bool = False
    reset_threshold_s: float = math.inf
    azimuth_bias: float = 0.0
    shortest_s: float = SHORTEST_S
    state: State = field(init=False)
    doubts: Counter[str] = field(init=False, default_factory=Counter)

    def __post_init__(self) -> None:
        self.state = State(AntennaTrack(self.rotation_s))

    def reset(self) -> None:
        """Forget all reports, but keep the time of a turn."""
        self.state = State(AntennaTrack(self.usual_s), self.state.found_s)

    @property
    def usual_s(self) -> float:
        """Time of a turn as first estimated or given, seconds; 0 if unknown."""
        return self.state.found_s or self.rotation_s

    @property
    def turn_s(self) -> float:
        """Time of a turn by the latest detections, seconds; 0 if unknown."""
        return self.state.track.rotation_s or self.usual_s

    @property
    def report_s(self) -> float:
        """Length of time that a report covers, seconds; 0 if unknown."""
        if self.sectors:
            return self.turn_s / self.sectors
        return min(self.state.horizon.step_s, self.turn_s)

    @property
    def _per_turn(self) -> int:
        """Number of reports per turn; 1 if unknown."""
        return max(round(self.turn_s / self.report_s), 1) if self.report_s else 1

    def behind(self, stamp_ns: int) -> bool:
        """Return whether a report is no newer than the latest of this run."""
        last_ns = self.state.last_ns
        if last_ns is None:
            return False
        return last_ns - self.reset_threshold_s * 1e9 <= stamp_ns <= last_ns

    def split(
        self, stamp_ns: int, detections: Detections, sector: int | None = None
    ) -> list[Piece] | Rejection:
        """Return the parts of a report, oldest first, each with its stamp and its coverage.

        Parameters
        ----------
        stamp_ns : int
        detections : Detections
        sector : int or None
            Number of the sector, if the report has one.

        Returns
        -------
        list of (stamp in nanoseconds, Detections)
            `time_s` is relative to the part's stamp, and stamps increase over all reports. The
            coverage is None if the report covers the radar's whole field.
        Rejection
            If the report belongs to a part of a turn that has been cut already.
        """
        sector = sector if self.sectors > 1 else None
        if self.behind(stamp_ns):
            return self._out_of_order(stamp_ns, detections, sector)
        if self.state.last_ns is not None and stamp_ns < self.state.last_ns:
            self.reset()
        report = _Report(stamp_ns, detections)
        self._follow(report)
        if not self.usual_s or (not report.timed and self._per_turn == 1):
            self._remember(report, report.own_s)
            self.state = self.state._replace(piece_ns=stamp_ns)
            return [(stamp_ns, detections)]
        steps, before = self._steps(report.stamp_s), self.state.number
        number = self._number(report, sector, steps)
        if steps < 0.5 and self._per_turn > 1 and self._again(report, number, before):
            self.doubts["sectors_repeated"] += 1
            return self._rising(report, [(stamp_ns, detections, UNKNOWN_COVERAGE)])
        start_s, end_s = self._covered_time(report, steps)
        parts, end = self._parts(report, number, start_s, end_s)
        self.state = self.state._replace(end_s=end_s, end=end)
        return self._rising(report, parts)

    def _out_of_order(
        self, stamp_ns: int, detections: Detections, sector: int | None
    ) -> list[Piece] | Rejection:
        """Return the parts of a report that is no newer than the latest; the state stays."""
        if not self.usual_s:
            return [(stamp_ns, detections)]
        if stamp_ns == self.state.last_ns:
            return Rejection.DUPLICATE
        if detections.time_s is not None:
            return Rejection.LATE
        # Without times it keeps its stamp, and its scan may still be open.
        known = UNKNOWN_COVERAGE if sector is None else self._coverage(sector)
        return [(stamp_ns, replace(detections, coverage=known))]

    def _follow(self, report: _Report) -> None:
        """Update the antenna's track by a report's detections."""
        before, horizon = self.state.track, self.state.horizon
        track, timed = before, not math.isnan(horizon.lead_s)
        if report.timed:
            # Detections' own times replace a track that was estimated from stamps.
            track = before if timed else AntennaTrack(self.usual_s)
            track = track.follow(report.stamp_s, report.own_s, report.azimuth, self.shortest_s)
        elif not timed:
            azimuth, shortest_s = report.azimuth, max(1.9 * horizon.step_s, self.shortest_s)
            if len(azimuth):
                # The antenna was somewhere in their arc at the stamp. Fewer than two reports per
                # turn do not show the motion.
                start, width = smallest_arc(azimuth)
                azimuth = np.full(len(azimuth) if self.usual_s else 1, start + 0.5 * width)
            time_s = np.full(len(azimuth), report.stamp_s)
            track = before.follow(report.stamp_s, time_s, azimuth, shortest_s)
            if self.sectors > 1:
                # Stamps give the turn more accurately than azimuths that are known by sector.
                track = track.turning_in(self.sectors * horizon.step_s)
        found_s = self.state.found_s if before.rotation_s else track.rotation_s
        self.doubts["antenna_unclear"] += track.unclear > before.unclear
        self.state = self.state._replace(
            track=track, found_s=found_s or self.state.found_s, last_ns=report.stamp_ns
        )

    def _steps(self, stamp_s: float) -> float:
        """Return the number of reports due since the previous one, including this one."""
        horizon = self.state.horizon
        if math.isnan(horizon.last_s) or not self.report_s or not horizon.regular:
            return 1.0
        return (stamp_s - horizon.last_s) / self.report_s

    def _number(self, report: _Report, sector: int | None, steps: float) -> int | None:
        """Return the sector's number: the reported one, or the next one for an empty report."""
        before, step, antenna = self.state.number, self.state.step, self.state.track.antenna
        if antenna is not None:
            step = 1 if (antenna.rate > 0.0) != self.compass else -1
        if sector is None:
            if not len(report.detections) and before is not None and step:
                sector = (before + step * max(round(steps), 1)) % self.sectors
        elif not is_sector(report.azimuth, self._coverage(sector)):
            self.doubts["sector_numbers_wrong"] += 1
            sector = None
        elif before is not None and self.sectors > 2:
            follows = {1: 1, self.sectors - 1: -1}
            step = follows.get((sector - before) % self.sectors, step)
        self.state = self.state._replace(number=sector, step=step)
        return sector

    def _again(self, report: _Report, number: int | None, before: int | None) -> bool:
        """Return whether an early report repeats what has been reported already."""
        if number is not None:
            return number == before
        return not report.timed or bool(report.own_s.max(initial=-math.inf) < self.state.end_s)

    def _coverage(self, sector: int) -> Coverage:
        """Return the coverage of a sector in true azimuths."""
        measured = coverage_of(sector, self.sectors, self.compass)
        start = math.remainder(measured.start - self.azimuth_bias, FULL_TURN)
        return Coverage(start, measured.width)

    def _remember(self, report: _Report, own_s: FloatArray) -> None:
        """Update the horizon by a report's stamp and its plausible detection times."""
        horizon = self.state.horizon.after(report.stamp_s, own_s, self.turn_s)
        self.state = self.state._replace(horizon=horizon)

    def _covered_time(self, report: _Report, steps: float) -> tuple[float, float]:
        """Return the begin and the end of the time that a report covers, seconds."""
        before_s, length_s, own_s = self.state.end_s, self.report_s, report.own_s
        if report.timed and (antenna := self.state.track.antenna) is not None:
            own_s = own_s[antenna.fits(own_s, report.azimuth)]
            self.doubts["times_disagree"] += len(report.detections) - len(own_s)
        self._remember(report, own_s)
        lead_s = np.nan_to_num(self.state.horizon.lead_s) if report.timed else 0.5 * length_s
        # No time is covered twice; for the first report `before_s` is NaN.
        end_s = float(np.fmax(report.stamp_s + lead_s, before_s))
        start_s, lost = end_s - LONGEST * self.turn_s, round(steps) >= 2
        if lost or math.isnan(before_s):
            # A detection from the gap shows that its part of the gap was not lost.
            start_s = max(start_s, min(end_s - length_s, own_s.min(initial=math.inf)))
        start_s = float(np.fmax(start_s, before_s))
        if lost and not math.isnan(before_s):
            self.doubts["clouds_missing"] += round((start_s - before_s) / length_s)
        late = own_s < start_s - LATE * self.turn_s
        self.doubts["detections_late"] += int(np.count_nonzero(late))
        return start_s, end_s

    def _parts(
        self, report: _Report, number: int | None, start_s: float, end_s: float
    ) -> tuple[list[_Part], float]:
        """Return the parts of a report, and the antenna's direction at its end, radians or NaN."""
        stamp_ns, detections = report.stamp_ns, report.detections
        antenna, sector = self.state.track.antenna, number is not None and self._coverage(number)
        if antenna is None or (sector and not report.timed):
            return [(stamp_ns, detections, sector or self._unclear(report))], math.nan
        if sector:
            # The number gives the azimuths, and the antenna's motion the times.
            half = math.copysign(0.5 * sector.width, antenna.rate)
            middle = sector.start + 0.5 * sector.width
            middle_s = antenna.time_near(middle, 0.5 * (start_s + end_s))
            start_s, end_s = middle_s - half / antenna.rate, middle_s + half / antenna.rate
            start, end = middle - half, middle + half
        else:
            start, end = antenna.azimuth_at(start_s), antenna.azimuth_at(end_s)
            if start_s == self.state.end_s and not math.isnan(self.state.end):
                # Joined edges leave out no azimuth between two reports, and cover none twice.
                off = math.remainder(start - self.state.end, FULL_TURN)
                start -= off if abs(off) < JOINED else 0.0
            start = start if (end - start) * antenna.rate > 0.0 else end
        if not report.timed:
            return [(stamp_ns, detections, _arc(start, end))], end
        count = max(1, round(SLICES * (end_s - start_s) / self.turn_s))
        edges_s, edges = np.linspace(start_s, end_s, count + 1), np.linspace(start, end, count + 1)
        place = np.clip(np.searchsorted(edges_s, report.own_s, side="right") - 1, 0, count - 1)
        middle_ns = np.rint((0.5 * (edges_s[1:] + edges_s[:-1]) - report.stamp_s) * 1e9)
        parts: list[_Part] = [
            (
                stamp_ns + int(middle_ns[k]),
                detections.take(np.flatnonzero(place == k)),
                _arc(edges[k], edges[k + 1]),
            )
            for k in range(count)
        ]
        return parts, end

    def _unclear(self, report: _Report) -> Coverage | None:
        """Return the coverage of a report while the antenna's motion is unknown."""
        shown = len(report.detections) >= LEAST_SHOWN
        width = smallest_arc(report.azimuth)[1] if shown else 0.0
        whole = width > AROUND or (self._per_turn == 1 and not (shown and width < STANDING))
        return None if whole else UNKNOWN_COVERAGE

    def _rising(self, report: _Report, parts: list[_Part]) -> list[Piece]:
        """Return the parts with strictly increasing stamps."""
        pieces = []
        for own_ns, part, coverage in parts:
            stamp_ns = max(own_ns, self.state.piece_ns + 1)
            self.state = self.state._replace(piece_ns=stamp_ns)
            time_s = part.time_s
            if time_s is not None:
                time_s = time_s + (report.stamp_ns - stamp_ns) * 1e-9
            pieces.append((stamp_ns, replace(part, time_s=time_s, coverage=coverage)))
        return pieces


def _arc(start: float, end: float) -> Coverage:
    """Return the coverage between two azimuths, radians; unknown if it is too narrow."""
    width = min(abs(end - start), FULL_TURN)
    if width <= UNKNOWN_COVERAGE.width:
        return UNKNOWN_COVERAGE
    return Coverage(math.remainder(min(start, end), FULL_TURN), width)
