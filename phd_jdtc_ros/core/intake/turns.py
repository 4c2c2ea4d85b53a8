"""Cuts the reports of a turning radar into slices, and says which azimuths each of them covers.

A surveillance antenna turns in some seconds, and what it has not passed it has not missed. A report
accounts for the time since the one before. If its detections have times of their own, this time is
cut into slices of about an eighth of a turn, and each detection goes to the slice of its time.
What a slice covers follows from the antenna's motion (see `antenna`), or from the sector's number
if the report says it. Where neither is known, nothing counts as missed.

A detection's time is a measurement and never changes. One that does not go with its azimuth, or
that comes after its time has been accounted for, is counted and used as it is.

A radar that does not turn sees its whole field at once. Its reports stay as they are, also where
its detections have times of their own: cut in pieces, none of them could say what was missed. So do
those of a radar of which nobody knows yet that it turns, for some two turns.
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

# Into so many slices a turn is cut; a target's motion during half of one is as good as straight.
SLICES = 8
# Where two reports meet, the old and the new line may differ by less than this, rad.
JOINED = 0.3
# So many detections show whether a report without an antenna's motion is of the whole field: they
# are on more than the first part of a turn, and those of an antenna that stands on less than the
# second, rad.
LEAST_SHOWN, AROUND, STANDING = 5, 0.75 * FULL_TURN, 0.25 * FULL_TURN
# A detection older than its report's begin by more than this part of a turn counts as late.
LATE = 0.5 / SLICES
# A report covers at most so many turns, however long ago the one before came.
LONGEST = 1.2

Piece = tuple[int, Detections]
_Part = tuple[int, Detections, Coverage | None]


class State(NamedTuple):
    """What the reports of a run say so far about the next one.

    Parameters
    ----------
    track : AntennaTrack
    found_s : float
        The turn that was found out, seconds; 0 for none. Wind does not change it.
    last_ns : int or None
        Stamp of the latest report.
    piece_ns : int
        Stamp of the latest slice.
    horizon : Horizon
        Of the reports that repeated none before them.
    end_s, end : float
        The time up to which the reports account for, and where the antenna pointed then, radians;
        NaN where that is not known.
    number : int or None
        Of the latest sector.
    step : int
        What numbers rise by from one sector to the next; 0 if it is not known.
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
    """A report, and its times in seconds."""

    stamp_ns: int
    detections: Detections

    @property
    def stamp_s(self) -> float:
        """Its stamp."""
        return self.stamp_ns * 1e-9

    @property
    def timed(self) -> bool:
        """Whether detections have times of their own."""
        return self.detections.time_s is not None

    @property
    def own_s(self) -> FloatArray:
        """These times, shape (M,); empty if there are none."""
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
        First guess of the time of a turn, seconds; 0 if nobody knows whether the antenna turns,
        which is then found out.
    sectors : int
        Number of reports to a turn; 0 if it is not known, or they come as they come.
    compass : bool
        Whether sectors are numbered clockwise from north; see `sectors`.
    reset_threshold_s : float
        A stamp that is further behind the latest than this begins a new run.
    azimuth_bias : float
        What the antenna's azimuths, by which sectors are numbered, are too large by, radians
        counter-clockwise. Those of the detections are right already.
    shortest_s : float
        A turn that is found out takes at least so long, seconds; infinite to look for none.

    Attributes
    ----------
    state : State
    doubts : Counter
        What was bridged, by what it is: ``clouds_missing``, ``sectors_repeated``,
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
        """Forget all reports, but not that the antenna turns."""
        self.state = State(AntennaTrack(self.usual_s), self.state.found_s)

    @property
    def usual_s(self) -> float:
        """Time of a turn as it was found out or given, seconds; 0 for none."""
        return self.state.found_s or self.rotation_s

    @property
    def turn_s(self) -> float:
        """Time of a turn as the latest detections show it, seconds; 0 for none."""
        return self.state.track.rotation_s or self.usual_s

    @property
    def report_s(self) -> float:
        """The time that a report is about, seconds; 0 if it is not known."""
        if self.sectors:
            return self.turn_s / self.sectors
        return min(self.state.horizon.step_s, self.turn_s)

    @property
    def _per_turn(self) -> int:
        """Number of reports to a turn; 1 if it is not known."""
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
            Number of the sector, if the report says it.

        Returns
        -------
        list of (stamp in nanoseconds, Detections)
            With `time_s` relative to their stamps, which rise from report to report. The coverage
            is None if the report covers the radar's whole field.
        Rejection
            If the report is a part of a turn that has been cut already.
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
        start_s, end_s = self._accounted(report, steps)
        parts, end = self._parts(report, number, start_s, end_s)
        self.state = self.state._replace(end_s=end_s, end=end)
        return self._rising(report, parts)

    def _out_of_order(
        self, stamp_ns: int, detections: Detections, sector: int | None
    ) -> list[Piece] | Rejection:
        """Return what becomes of a report that is no newer than the latest; nothing follows."""
        if not self.usual_s:
            return [(stamp_ns, detections)]
        if stamp_ns == self.state.last_ns:
            return Rejection.DUPLICATE
        if detections.time_s is not None:
            return Rejection.LATE
        # Without times its stamp stays, and who groups scans may still have a place for it.
        known = UNKNOWN_COVERAGE if sector is None else self._coverage(sector)
        return [(stamp_ns, replace(detections, coverage=known))]

    def _follow(self, report: _Report) -> None:
        """Follow the antenna by where a report's detections are."""
        before, horizon = self.state.track, self.state.horizon
        track, timed = before, not math.isnan(horizon.lead_s)
        if report.timed:
            # Times of their own tell more than the stamps did.
            track = before if timed else AntennaTrack(self.usual_s)
            track = track.followed(report.stamp_s, report.own_s, report.azimuth, self.shortest_s)
        elif not timed:
            azimuth, shortest_s = report.azimuth, max(1.9 * horizon.step_s, self.shortest_s)
            if len(azimuth):
                # Somewhere in their sector; of less than two reports to a turn nothing shows.
                start, width = smallest_arc(azimuth)
                azimuth = np.full(len(azimuth) if self.usual_s else 1, start + 0.5 * width)
            time_s = np.full(len(azimuth), report.stamp_s)
            track = before.followed(report.stamp_s, time_s, azimuth, shortest_s)
            if self.sectors > 1:
                # Stamps tell the turn better than azimuths that are somewhere in their sectors.
                track = track.turning_in(self.sectors * horizon.step_s)
        found_s = self.state.found_s if before.rotation_s else track.rotation_s
        self.doubts["antenna_unclear"] += track.unclear > before.unclear
        self.state = self.state._replace(
            track=track, found_s=found_s or self.state.found_s, last_ns=report.stamp_ns
        )

    def _steps(self, stamp_s: float) -> float:
        """Return how many reports are due since the one before, this one included."""
        horizon = self.state.horizon
        if math.isnan(horizon.last_s) or not self.report_s or not horizon.regular:
            return 1.0
        return (stamp_s - horizon.last_s) / self.report_s

    def _number(self, report: _Report, sector: int | None, steps: float) -> int | None:
        """Return the number of the sector: what the report says, or the next one if it is empty."""
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
        """Return whether an early report is of what has been reported, and not of the next part."""
        if number is not None:
            return number == before
        return not report.timed or bool(report.own_s.max(initial=-math.inf) < self.state.end_s)

    def _coverage(self, sector: int) -> Coverage:
        """Return the true azimuths of a sector."""
        measured = coverage_of(sector, self.sectors, self.compass)
        start = math.remainder(measured.start - self.azimuth_bias, FULL_TURN)
        return Coverage(start, measured.width)

    def _remember(self, report: _Report, own_s: FloatArray) -> None:
        """Take in when a report came, and those times of its detections that are believed."""
        horizon = self.state.horizon.after(report.stamp_s, own_s, self.turn_s)
        self.state = self.state._replace(horizon=horizon)

    def _accounted(self, report: _Report, steps: float) -> tuple[float, float]:
        """Return the times from which and to which a report accounts for."""
        before_s, length_s, own_s = self.state.end_s, self.report_s, report.own_s
        if report.timed and (antenna := self.state.track.antenna) is not None:
            own_s = own_s[antenna.fits(own_s, report.azimuth)]
            self.doubts["times_disagree"] += len(report.detections) - len(own_s)
        self._remember(report, own_s)
        lead_s = np.nan_to_num(self.state.horizon.lead_s) if report.timed else 0.5 * length_s
        # No time is accounted for twice; of the first report `before_s` is NaN.
        end_s = float(np.fmax(report.stamp_s + lead_s, before_s))
        start_s, lost = end_s - LONGEST * self.turn_s, round(steps) >= 2
        if lost or math.isnan(before_s):
            # A detection from the gap shows that what it is of was not lost.
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
        """Return the parts of a report, and where the antenna points at its end, radians or NaN."""
        stamp_ns, detections = report.stamp_ns, report.detections
        antenna, sector = self.state.track.antenna, number is not None and self._coverage(number)
        if antenna is None or (sector and not report.timed):
            return [(stamp_ns, detections, sector or self._unclear(report))], math.nan
        if sector:
            # The number says where, and the antenna when.
            half = math.copysign(0.5 * sector.width, antenna.rate)
            middle = sector.start + 0.5 * sector.width
            middle_s = antenna.time_near(middle, 0.5 * (start_s + end_s))
            start_s, end_s = middle_s - half / antenna.rate, middle_s + half / antenna.rate
            start, end = middle - half, middle + half
        else:
            start, end = antenna.azimuth_at(start_s), antenna.azimuth_at(end_s)
            if start_s == self.state.end_s and not math.isnan(self.state.end):
                # No azimuth between two reports is left out, and none is passed twice.
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
        """Return what a report covers while the antenna's motion is not known."""
        shown = len(report.detections) >= LEAST_SHOWN
        width = smallest_arc(report.azimuth)[1] if shown else 0.0
        whole = width > AROUND or (self._per_turn == 1 and not (shown and width < STANDING))
        return None if whole else UNKNOWN_COVERAGE

    def _rising(self, report: _Report, parts: list[_Part]) -> list[Piece]:
        """Return parts, each with a stamp above those before it."""
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
    """Return the azimuths from one to another, radians, of which none need be passed."""
    width = min(abs(end - start), FULL_TURN)
    if width <= UNKNOWN_COVERAGE.width:
        return UNKNOWN_COVERAGE
    return Coverage(math.remainder(min(start, end), FULL_TURN), width)
