# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

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

from .antenna import SHORTEST_S, Antenna, AntennaTrack
from .arrays import FloatArray, IntArray
from .horizon import Horizon
from .scans import Rejection
from .sectors import coverage_of, is_sector, smallest_arc
from .types import FULL_TURN, UNKNOWN_COVERAGE, Coverage, Detections

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


class State(NamedTuple):
    """What the reports of a run say so far about the next one.

    Parameters
    ----------
    track : AntennaTrack
    zero_ns, last_ns : int or None
        Stamps of the first report and of the latest one.
    piece_ns : int
        Stamp of the latest slice.
    timed : bool
        Whether detections had times of their own.
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
    zero_ns: int | None = None
    last_ns: int | None = None
    piece_ns: int = 0
    timed: bool = False
    horizon: Horizon = Horizon()
    end_s: float = math.nan
    end: float = math.nan
    number: int | None = None
    step: int = 0


class _Report(NamedTuple):
    """A report in the run's seconds; `time_s` has the stamp's where detections have none."""

    stamp_ns: int
    stamp_s: float
    detections: Detections
    time_s: FloatArray
    timed: bool

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
        What was bridged or found, by what it is: ``clouds_missing``, ``sectors_repeated``,
        ``sector_numbers_wrong``, ``antenna_unclear``, ``times_disagree``, ``detections_late`` and
        ``turn_found_ms``, which is no number but the turn.
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
        self.reset()

    def reset(self) -> None:
        """Forget all reports, but not that the antenna turns."""
        self.state = State(AntennaTrack(self.rotation_s))

    @property
    def turn_s(self) -> float:
        """Time of a turn as the detections show it, seconds; 0 for none, as far as is known."""
        return self.state.track.rotation_s or self.rotation_s

    @property
    def report_s(self) -> float:
        """The time that a report is about, seconds; 0 if it is not known."""
        if self.sectors > 1:
            return self.turn_s / self.sectors
        return min(self.state.horizon.step_s, self.turn_s)

    @property
    def _per_turn(self) -> int:
        """Number of reports to a turn; 1 if it is not known."""
        if self.sectors:
            return self.sectors
        return max(round(self.turn_s / self.report_s), 1) if self.report_s else 1

    def behind(self, stamp_ns: int) -> bool:
        """Return whether a report is older than the latest of this run, and its place matters."""
        last_ns = self.state.last_ns
        if last_ns is None or not self.rotation_s:
            return False
        return last_ns - self.reset_threshold_s * 1e9 <= stamp_ns < last_ns

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
        timed = detections.time_s is not None
        if self.behind(stamp_ns):
            # Without times its stamp stays, and who groups scans may still have a place for it.
            known = UNKNOWN_COVERAGE if sector is None else self._coverage(sector)
            late = [(stamp_ns, replace(detections, coverage=known))]
            return Rejection.LATE if timed else late
        last_ns = self.state.last_ns
        if self.rotation_s and stamp_ns == last_ns:
            return Rejection.DUPLICATE
        if last_ns is not None and stamp_ns < last_ns - self.reset_threshold_s * 1e9:
            self.reset()
        elif last_ns is not None and stamp_ns < last_ns:
            return [(stamp_ns, detections)]
        report = self._report(stamp_ns, detections)
        self.state = self._followed(report)
        if not self.rotation_s or (not timed and self._per_turn == 1):
            horizon = self.state.horizon.after(report.stamp_s, report.time_s[:0], self.turn_s)
            self.state = self.state._replace(horizon=horizon, piece_ns=stamp_ns)
            return [(stamp_ns, detections)]
        return self._cut(report, sector if self.sectors > 1 else None)

    def _report(self, stamp_ns: int, detections: Detections) -> _Report:
        if self.state.zero_ns is None:
            self.state = self.state._replace(zero_ns=stamp_ns)
        stamp_s = (stamp_ns - (self.state.zero_ns or 0)) * 1e-9
        own = np.zeros(len(detections)) if detections.time_s is None else detections.time_s
        return _Report(stamp_ns, stamp_s, detections, stamp_s + own, detections.time_s is not None)

    def _followed(self, report: _Report) -> State:
        """Return what is known with where a report's detections are."""
        state = self.state._replace(last_ns=report.stamp_ns)
        if report.timed and not state.timed:
            # Times of their own tell more than the stamps did.
            state = state._replace(timed=True, track=AntennaTrack(self.rotation_s))
        time_s, azimuth, shortest_s = report.time_s, report.azimuth, self.shortest_s
        if not state.timed and len(azimuth):
            # Somewhere in their sector; of less than two reports to a turn nothing shows.
            start, width = smallest_arc(azimuth)
            azimuth = np.full(len(azimuth) if self.rotation_s else 1, start + 0.5 * width)
            time_s = time_s[: len(azimuth)]
            shortest_s = max(1.9 * state.horizon.step_s, shortest_s)
        if report.timed == state.timed:
            track = state.track.followed(report.stamp_s, time_s, azimuth, shortest_s)
            if not state.timed and self.sectors > 1:
                # Stamps tell the turn better than azimuths that are somewhere in their sectors.
                track = track.turning_in(self.sectors * state.horizon.step_s)
            state = state._replace(track=track)
        if not self.state.track.rotation_s and state.track.rotation_s:
            if not self.rotation_s:
                self.doubts["turn_found_ms"] = round(1e3 * state.track.rotation_s)
            self.rotation_s = state.track.rotation_s
        self.doubts["antenna_unclear"] += state.track.unclear > self.state.track.unclear
        return state

    def _cut(self, report: _Report, sector: int | None) -> list[Piece]:
        """Return the parts of a report that is newer than those before it."""
        steps = self._steps(report)
        before = self.state.number
        number = self._number_of(report, sector, max(round(steps), 1))
        if self._repeats(report, before, steps):
            self.doubts["sectors_repeated"] += 1
            return [self._piece(report.stamp_ns, report, UNKNOWN_COVERAGE)]
        own, antenna = (
            report.time_s if report.timed else report.time_s[:0],
            self.state.track.antenna,
        )
        if report.timed and antenna is not None:
            own = own[antenna.fits(own, report.azimuth)]
            self.doubts["times_disagree"] += len(report.time_s) - len(own)
        horizon = self.state.horizon.after(report.stamp_s, own, self.turn_s)
        self.state = self.state._replace(horizon=horizon)
        start_s, end_s = self._accounted(report, own, steps)
        late = own < start_s - LATE * self.turn_s
        self.doubts["detections_late"] += int(np.count_nonzero(late))
        pieces, end = self._covering(report, number, start_s, end_s)
        self.state = self.state._replace(end_s=end_s, end=end)
        return pieces

    def _steps(self, report: _Report) -> float:
        """Return how many reports are due since the one before, this one included."""
        horizon = self.state.horizon
        if not horizon.reports or not self.report_s or not horizon.regular:
            return 1.0
        return (report.stamp_s - horizon.reports[-1].stamp_s) / self.report_s

    def _accounted(self, report: _Report, own: FloatArray, steps: float) -> tuple[float, float]:
        """Return the times from which and to which a report accounts for."""
        before_s, length_s = self.state.end_s, self.report_s
        lead_s = self.state.horizon.lead_s if report.timed else 0.5 * length_s
        end_s = report.stamp_s + (0.0 if math.isnan(lead_s) else lead_s)
        end_s = end_s if math.isnan(before_s) else max(end_s, before_s)
        longest_s = end_s - LONGEST * self.turn_s
        if math.isnan(before_s):
            least_s = end_s - (length_s if self.sectors > 1 else 0.0)
            return max(min(own.min(initial=math.inf), least_s), longest_s), end_s
        if round(steps) < 2:
            return max(before_s, longest_s), end_s
        # A detection from the gap shows that what it is of was not lost.
        start_s = max(before_s, longest_s, min(end_s - length_s, own.min(initial=math.inf)))
        self.doubts["clouds_missing"] += round((start_s - before_s) / length_s)
        return start_s, end_s

    def _number_of(self, report: _Report, sector: int | None, steps: int) -> int | None:
        """Return the number of the sector: what the report says, or the next one if it is empty."""
        state = self.state
        if self.sectors < 2:
            return None
        antenna = state.track.antenna
        if antenna is not None:
            way = 1 if antenna.rate > 0.0 else -1
            state = state._replace(step=-way if self.compass else way)
        if sector is None:
            if not len(report.detections) and state.number is not None and state.step:
                sector = (state.number + state.step * steps) % self.sectors
        elif not is_sector(report.azimuth, self._coverage(sector)):
            self.doubts["sector_numbers_wrong"] += 1
            sector = None
        elif state.number is not None and self.sectors > 2:
            follows = {1: 1, self.sectors - 1: -1}
            step = follows.get((sector - state.number) % self.sectors, state.step)
            state = state._replace(step=step)
        self.state = state._replace(number=sector)
        return sector

    def _coverage(self, sector: int) -> Coverage:
        """Return the true azimuths of a sector."""
        measured = coverage_of(sector, self.sectors, self.compass)
        start = math.remainder(measured.start - self.azimuth_bias, FULL_TURN)
        return Coverage(start, measured.width)

    def _repeats(self, report: _Report, before: int | None, steps: float) -> bool:
        """Return whether a report is of azimuths that the antenna cannot have passed again."""
        number = self.state.number
        if number is not None and number != before:
            return False
        again = not report.timed or report.time_s.max(initial=-math.inf) < self.state.end_s
        return (number is not None or again) and steps < 0.5 and self._per_turn > 1

    def _covering(
        self, report: _Report, number: int | None, start_s: float, end_s: float
    ) -> tuple[list[Piece], float]:
        """Return the parts of a report, and where the antenna points at its end, radians."""
        antenna = self.state.track.antenna
        if number is not None:
            sector = self._coverage(number)
            if antenna is None or not report.timed:
                return [self._piece(report.stamp_ns, report, sector)], math.nan
            half = 0.5 * sector.width
            middle = sector.start + half
            middle_s = antenna.time_near(middle, 0.5 * (start_s + end_s))
            half_s, way = half / abs(antenna.rate), math.copysign(half, antenna.rate)
            times_s, azimuths = (middle_s - half_s, middle_s + half_s), (middle - way, middle + way)
            return self._slices(report, antenna, times_s, azimuths), azimuths[1]
        if antenna is None:
            coverage = self._unclear(report)
            return [self._piece(report.stamp_ns, report, coverage)], math.nan
        start, end = antenna.azimuth_at(start_s), antenna.azimuth_at(end_s)
        if start_s == self.state.end_s and not math.isnan(self.state.end):
            # No azimuth between two reports is left out, and none is passed twice.
            off = math.remainder(start - self.state.end, FULL_TURN)
            start -= off if abs(off) < JOINED else 0.0
        return self._slices(report, antenna, (start_s, end_s), (start, end)), end

    def _unclear(self, report: _Report) -> Coverage | None:
        """Return what a report covers while the antenna's motion is not known."""
        shown = len(report.detections) >= LEAST_SHOWN
        width = smallest_arc(report.azimuth)[1] if shown else 0.0
        if width > AROUND or (self._per_turn == 1 and not (shown and width < STANDING)):
            return None
        return UNKNOWN_COVERAGE

    def _slices(
        self,
        report: _Report,
        antenna: Antenna,
        times_s: tuple[float, float],
        azimuths: tuple[float, float],
    ) -> list[Piece]:
        """Return the slices of the time that a report accounts for, in their order."""
        (start_s, end_s), (start, end) = times_s, azimuths
        if not report.timed:
            return [self._piece(report.stamp_ns, report, _coverage(start, end, antenna))]
        count = max(1, round(SLICES * (end_s - start_s) / antenna.turn_s))
        edges_s, edges = np.linspace(start_s, end_s, count + 1), np.linspace(start, end, count + 1)
        place = np.clip(np.searchsorted(edges_s, report.time_s, side="right") - 1, 0, count - 1)
        pieces = []
        for k in range(count):
            middle_s = 0.5 * (edges_s[k] + edges_s[k + 1])
            stamp_ns = report.stamp_ns + round((middle_s - report.stamp_s) * 1e9)
            coverage = _coverage(edges[k], edges[k + 1], antenna)
            pieces.append(self._piece(stamp_ns, report, coverage, np.flatnonzero(place == k)))
        return pieces

    def _piece(
        self,
        stamp_ns: int,
        report: _Report,
        coverage: Coverage | None,
        rows: IntArray | None = None,
    ) -> Piece:
        """Return a part with a stamp above those before it."""
        part = report.detections if rows is None else report.detections.take(rows)
        stamp_ns = max(stamp_ns, self.state.piece_ns + 1)
        self.state = self.state._replace(piece_ns=stamp_ns)
        time_s = part.time_s
        if time_s is not None:
            time_s = time_s + (report.stamp_ns - stamp_ns) * 1e-9
        return stamp_ns, replace(part, time_s=time_s, coverage=coverage)


def _coverage(start: float, end: float, antenna: Antenna) -> Coverage:
    """Return the azimuths that an antenna passes from one to another."""
    passed = (end - start) if antenna.rate > 0.0 else start - end
    if passed <= UNKNOWN_COVERAGE.width:
        return UNKNOWN_COVERAGE
    first = start if antenna.rate > 0.0 else end
    return Coverage(math.remainder(first, FULL_TURN), min(passed, FULL_TURN))
