# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cuts the reports of a turning radar into slices, and says which azimuths each of them covers.

A surveillance antenna turns in some seconds, and what it has not passed it has not missed. Its
detections' own times say where it was when; a whole turn with one stamp becomes slices of a
sixteenth, each with the time of its middle as its stamp. A report that is a sector keeps its
detections and gets the azimuths of that sector: from its number, or from where the sector before
it ended and where its detections are.

A radar that does not turn sees its whole field at once. Its reports stay as they are, also where
its detections have times of their own: cut in pieces, none of them could say what was missed.
"""

from __future__ import annotations

import copy
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .antenna import Antenna, AntennaEstimator, BoolArray, wrapped
from .arrays import FloatArray
from .scans import Rejection
from .sectors import coverage_of, smallest_arc
from .types import FULL_TURN, Coverage, Detections

# Into so many slices a turn is cut; a target's motion during half of one is as good as straight.
SLICES = 16
# What a report covers that says nothing of what was missed.
NOTHING = Coverage(0.0, 1e-9)
# A detection this far beyond the expected end moves it, rad.
TOLERANCE = math.radians(0.1)
# Detections of a turn may be so many turns beyond what is expected before that is given up.
LARGEST_SHIFT = 0.3
# Those of a sector may be half a sector beyond, and at least this, rad: some come with the next.
LEAST_MARGIN = math.radians(20.0)
# So few detections beside a sector do not say that its number is wrong.
LEAST_NEAR = 3
# A report of a turn may be longer than the turn by this part of it.
LONGER_TURN = 0.15
# Phases less turns than this from what is expected are of the same turn.
SAME_TURN = 0.75
# Of detections on an arc smaller than this the antenna may have stood still.
STILL, LEAST_STILL = 0.5 * math.pi, 5

Piece = tuple[int, Detections]


@dataclass(frozen=True)
class _Cloud:
    """A report in the run's seconds.

    Parameters
    ----------
    stamp_ns : int
    stamp_s : float
    detections : Detections
    time_s : array of shape (M,)
        Of each detection; the stamp's where it has none of its own.
    advance : float
        Number of reports that are due since the one before, this one included, by their stamps; 1
        for the first one.
    """

    stamp_ns: int
    stamp_s: float
    detections: Detections
    time_s: FloatArray
    advance: float

    @property
    def azimuth(self) -> FloatArray:
        """Azimuths of the detections, radians, shape (M,)."""
        azimuth: FloatArray = self.detections.measurement[:, 1]
        return azimuth

    @property
    def missing(self) -> int:
        """Number of reports that are missing before this one."""
        return max(round(self.advance), 1) - 1

    @property
    def timed(self) -> bool:
        """Whether the detections have times of their own."""
        return self.detections.time_s is not None

    def __len__(self) -> int:
        return len(self.detections)


@dataclass
class Turns:
    """Cuts the reports of one radar.

    Parameters
    ----------
    rotation_s : float
        Time of one turn of the antenna, seconds; 0 if it does not turn.
    sectors : int
        Number of reports to a turn; 0 if a report is a whole turn.
    compass : bool
        Whether sectors are numbered clockwise from north; see `sectors`.
    reset_threshold_s : float
        A stamp that is further behind the latest than this begins a new run.
    azimuth_bias : float
        What the antenna's azimuths, by which sectors are cut, are too large by, radians
        counter-clockwise. Those of the detections are right already.

    Attributes
    ----------
    doubts : Counter
        What was bridged, by what it is: ``clouds_missing``, ``sectors_repeated``,
        ``sector_numbers_wrong``, ``antenna_unclear``, ``antenna_slipped`` and ``times_repaired``.
    """

    rotation_s: float = 0.0
    sectors: int = 0
    compass: bool = False
    reset_threshold_s: float = math.inf
    azimuth_bias: float = 0.0
    doubts: Counter[str] = field(init=False, default_factory=Counter)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all reports."""
        self._zero_ns: int | None = None
        self._last_ns = 0
        # The stamp of the last report that repeated none.
        self._regular_ns = 0
        self._last_piece_ns = 0
        # The phase up to which the reports have covered the turns, and when the antenna was there.
        self._edge: tuple[float, float] | None = None
        self._direction = 0
        self._number: int | None = None
        self._step = 0
        self._reported_s: dict[int, float] = {}
        self._estimators: dict[bool, AntennaEstimator] = {}

    def hold(self) -> dict[str, Any]:
        """Return what is known of the antenna and its reports, for `recall`."""
        return {
            **vars(self),
            "_reported_s": dict(self._reported_s),
            "_estimators": {key: copy.copy(own) for key, own in self._estimators.items()},
        }

    def recall(self, held: Mapping[str, Any]) -> None:
        """Return to what was held; what was counted since stays counted."""
        doubts = self.doubts
        vars(self).update(held)
        self._reported_s, self.doubts = dict(held["_reported_s"]), doubts
        self._estimators = {key: copy.copy(one) for key, one in held["_estimators"].items()}

    def behind(self, stamp_ns: int) -> bool:
        """Return whether a report is older than the latest of this run, and its place matters."""
        if not self.cutting or self._zero_ns is None:
            return False
        return self._last_ns - self.reset_threshold_s * 1e9 <= stamp_ns < self._last_ns

    @property
    def cutting(self) -> bool:
        """Whether a report's parts may depend on the reports before it."""
        return self.rotation_s > 0.0

    @property
    def _per_turn(self) -> int:
        """Number of reports to a turn."""
        return max(self.sectors, 1)

    @property
    def _width(self) -> float:
        """What a report covers, radians."""
        return FULL_TURN / self._per_turn

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
        if not self.rotation_s or (self._per_turn == 1 and detections.time_s is None):
            return [(stamp_ns, detections)]
        if self._zero_ns is not None:
            if stamp_ns < self._last_ns - self.reset_threshold_s * 1e9:
                self.reset()
            elif stamp_ns == self._last_ns:
                return Rejection.DUPLICATE
            elif stamp_ns < self._last_ns and detections.time_s is None:
                # Its stamp stays, and who groups scans may still have a place for it.
                return [(stamp_ns, replace(detections, coverage=self._known(sector)))]
            elif stamp_ns < self._last_ns:
                return Rejection.LATE
        cloud = self._cloud(stamp_ns, detections)
        pieces = self._pieces(cloud, sector)
        self._last_ns = stamp_ns
        return pieces

    def _known(self, sector: int | None) -> Coverage:
        return NOTHING if sector is None else self._coverage(sector)

    def _coverage(self, sector: int) -> Coverage:
        """Return the true azimuths of a sector."""
        measured = coverage_of(sector, self.sectors, self.compass)
        start = math.remainder(measured.start - self.azimuth_bias, FULL_TURN)
        return Coverage(start, measured.width)

    def _cloud(self, stamp_ns: int, detections: Detections) -> _Cloud:
        if self._zero_ns is None:
            self._zero_ns = self._regular_ns = stamp_ns
        stamp_s = (stamp_ns - self._zero_ns) * 1e-9
        own = detections.time_s
        time_s = stamp_s + (np.zeros(len(detections)) if own is None else own)
        since_s = (stamp_ns - self._regular_ns) * 1e-9
        antenna = self._estimator(own is not None).antenna
        turn_s = self.rotation_s if antenna is None else FULL_TURN / antenna.rate
        advance = since_s * self._per_turn / turn_s if since_s else 1.0
        return _Cloud(stamp_ns, stamp_s, detections, time_s, advance)

    def _estimator(self, timed: bool) -> AntennaEstimator:
        if timed not in self._estimators:
            spread = 0.0 if timed else 0.5 * self._width
            self._estimators[timed] = AntennaEstimator(self.rotation_s, spread)
        return self._estimators[timed]

    def _pieces(self, cloud: _Cloud, sector: int | None) -> list[Piece]:
        """Return the parts of a report that is newer than those before it."""
        estimator = self._estimator(cloud.timed)
        antenna = estimator.update(cloud.time_s, cloud.azimuth)
        self.doubts["antenna_unclear"] += estimator.unclear > 0
        if antenna is not None and antenna.direction != self._direction:
            self._edge, self._direction = None, antenna.direction
        number = self._number_of(cloud, sector)
        if self._repeats(cloud, number, antenna):
            self.doubts["sectors_repeated"] += 1
            return [self._piece(cloud.stamp_ns, cloud, NOTHING)]
        self.doubts["clouds_missing"] += cloud.missing
        pieces = self._covering(cloud, number, antenna, estimator.unclear > 0)
        self._regular_ns = cloud.stamp_ns
        return pieces

    def _covering(
        self, cloud: _Cloud, number: int | None, antenna: Antenna | None, unclear: bool
    ) -> list[Piece]:
        """Return the parts of a report of azimuths that the one before did not cover."""
        if number is not None:
            self._number = number
            self._reported_s[number] = cloud.stamp_s
            coverage = self._coverage(number)
            if antenna is None or not cloud.timed:
                return [self._piece(cloud.stamp_ns, cloud, coverage)]
            start = self._start_of(coverage, cloud, antenna)
            end = start + coverage.width
        elif antenna is None:
            self._edge = None
            return [self._piece(cloud.stamp_ns, cloud, self._guessed(cloud, unclear))]
        else:
            start, end = self._continued(cloud, antenna)
        if not len(cloud):
            antenna = self._tied(cloud, antenna, end)
        self._edge = end, float(antenna.time_of(np.array(end)))
        return self._cut(cloud, antenna, start, end)

    def _number_of(self, cloud: _Cloud, sector: int | None) -> int | None:
        """Return the number of the sector: what the report says, or the next one if it is empty."""
        if self._per_turn == 1:
            return None
        if self._direction:
            self._step = -self._direction if self.compass else self._direction
        if sector is None:
            if len(cloud) or self._number is None or not self._step:
                return None
            return (self._number + self._step * (cloud.missing + 1)) % self.sectors
        coverage = self._coverage(sector)
        middle = coverage.start + 0.5 * coverage.width
        near = np.abs(wrapped(cloud.azimuth - middle)) <= 0.5 * coverage.width + self._margin
        if len(cloud) >= LEAST_NEAR and 2 * np.count_nonzero(near) < len(cloud):
            self.doubts["sector_numbers_wrong"] += 1
            self._number = None
            return None
        if self._number is not None and self.sectors > 2:
            follows = {1: 1, self.sectors - 1: -1}
            self._step = follows.get((sector - self._number) % self.sectors, self._step)
        return sector

    def _repeats(self, cloud: _Cloud, number: int | None, antenna: Antenna | None) -> bool:
        """Return whether a report is of azimuths that the antenna cannot have passed again."""
        if number is not None:
            last_s = self._reported_s.get(number, -math.inf)
            return cloud.stamp_s - last_s < 0.5 * self.rotation_s
        if cloud.advance >= 0.5 or self._edge is None or antenna is None:
            return False
        if not len(cloud):
            return True
        return float(np.median(antenna.phase_of(cloud.azimuth, cloud.time_s))) < self._edge[0]

    def _start_of(self, coverage: Coverage, cloud: _Cloud, antenna: Antenna) -> float:
        """Return the phase at which a sector begins, in the turn in which it is reported."""
        start = coverage.start
        if antenna.direction < 0:
            start = -coverage.start - coverage.width
        if self._edge is not None:
            expected = self._edge[0] + (cloud.missing + 0.5) * coverage.width
        else:
            middle_s = float(np.median(cloud.time_s)) if len(cloud) else cloud.stamp_s
            expected = float(antenna.phase_at(np.array(middle_s)))
        turns = round((expected - start - 0.5 * coverage.width) / FULL_TURN)
        return start + turns * FULL_TURN

    def _tied(self, cloud: _Cloud, antenna: Antenna, end: float) -> Antenna:
        """Return the motion during a report without detections, of which only the stamp is known.

        The antenna is where it was as long before the report's end as it was the last time.
        """
        if self._edge is None:
            return antenna
        since_s = (cloud.stamp_ns - self._regular_ns) * 1e-9
        tied = antenna.through(self._edge[1] + since_s, end)
        self._estimator(cloud.timed).antenna = tied
        return tied

    def _guessed(self, cloud: _Cloud, unclear: bool) -> Coverage | None:
        """Return what a report covers while the antenna's motion is not known."""
        if not len(cloud):
            return None if self._per_turn == 1 else NOTHING
        start, width = smallest_arc(cloud.azimuth)
        if self._per_turn == 1:
            still = unclear and len(cloud) >= LEAST_STILL and width < STILL
            return Coverage(start, max(width, TOLERANCE)) if still else None
        # Its detections are in its sector, wherever in it.
        wider = max(self._width, width)
        return Coverage(start + 0.5 * (width - wider), wider)

    @property
    def _margin(self) -> float:
        """How far detections may be beyond what is expected before it is given up, radians."""
        if self._per_turn == 1:
            return LARGEST_SHIFT * FULL_TURN
        return max(0.5 * self._width, LEAST_MARGIN)

    def _continued(self, cloud: _Cloud, antenna: Antenna) -> tuple[float, float]:
        """Return the phases from which and to which a report covers, after the one before it."""
        fitting = self._estimator(cloud.timed).fits(antenna, cloud.time_s, cloud.azimuth)
        own = antenna.phase_of(cloud.azimuth, cloud.time_s)[fitting]
        if self._edge is None:
            return self._anchored(cloud, antenna, own)
        start = self._edge[0] + cloud.missing * self._width
        if not len(own):
            return start, start + self._width
        turns = (float(np.median(own)) - start - 0.5 * self._width) / FULL_TURN
        if abs(turns) > SAME_TURN:
            start += round(turns) * FULL_TURN
        inside = own[np.abs(own - start - 0.5 * self._width) <= 0.5 * self._width + self._margin]
        if 2 * len(inside) < len(own):
            self.doubts["antenna_slipped"] += 1
            return self._anchored(cloud, antenna, own)
        first, last = _densest(inside, self._longest)
        return self._moved(start, last - start - self._width, start - first)

    @property
    def _longest(self) -> float:
        """The most that the detections of a report extend over, radians."""
        return self._width + (LONGER_TURN * FULL_TURN if self._per_turn == 1 else self._margin)

    def _moved(self, start: float, over: float, under: float) -> tuple[float, float]:
        """Return what a report covers whose detections are beyond its end and before its start.

        Beyond both, a turn was longer than a turn. Sectors overlap then, and are centred on their
        detections, so that no target is missed twice.
        """
        end = start + self._width
        if over > TOLERANCE and under > TOLERANCE:
            if self._per_turn == 1:
                return start - under, end + over
            shift = 0.5 * (over - under)
            return start + min(shift, 0.0), end + shift
        if over > TOLERANCE:
            return start, end + over
        return (start - under, end - under) if under > TOLERANCE else (start, end)

    def _anchored(self, cloud: _Cloud, antenna: Antenna, own: FloatArray) -> tuple[float, float]:
        """Return the phases that a report covers by its detections' phases alone."""
        middle, half = float(antenna.phase_at(np.array(cloud.stamp_s))), 0.5 * self._width
        if cloud.timed and len(own):
            first, last = _densest(own, self._longest)
            middle, half = 0.5 * (first + last), max(half, 0.5 * (last - first))
        return middle - half, middle + half

    def _cut(self, cloud: _Cloud, antenna: Antenna, start: float, end: float) -> list[Piece]:
        """Return the slices of what a report covers, in the order in which they were passed."""
        if not cloud.timed:
            return [self._piece(cloud.stamp_ns, cloud, _coverage(start, end, antenna.direction))]
        cloud, phase = self._repaired(cloud, antenna, start, end)
        count = max(1, round(SLICES * (end - start) / FULL_TURN))
        edges = np.linspace(start, end, count + 1)
        place = np.clip(np.searchsorted(edges, phase, side="right") - 1, 0, count - 1)
        pieces = []
        for k in range(count):
            middle_s = float(antenna.time_of(0.5 * (edges[k] + edges[k + 1])))
            stamp_ns = cloud.stamp_ns + round((middle_s - cloud.stamp_s) * 1e9)
            coverage = _coverage(edges[k], edges[k + 1], antenna.direction)
            pieces.append(self._piece(stamp_ns, cloud, coverage, place == k))
        return pieces

    def _repaired(
        self, cloud: _Cloud, antenna: Antenna, start: float, end: float
    ) -> tuple[_Cloud, FloatArray]:
        """Return a report with the antenna's times where detections' times are wrong, and phases.

        A detection whose time and azimuth do not go together has its azimuth's time in this turn.
        """
        phase = antenna.phase_of(cloud.azimuth, cloud.time_s)
        wrong = ~self._estimator(True).fits(antenna, cloud.time_s, cloud.azimuth)
        wrong |= (phase < start - TOLERANCE) | (phase > end + TOLERANCE)
        passed = start + np.mod(antenna.direction * cloud.azimuth - start, FULL_TURN)
        wrong &= passed <= end
        if not wrong.any():
            return cloud, phase
        self.doubts["times_repaired"] += int(np.count_nonzero(wrong))
        time_s = np.where(wrong, antenna.time_of(passed), cloud.time_s)
        own = replace(cloud.detections, time_s=time_s - cloud.stamp_s)
        repaired = replace(cloud, time_s=time_s, detections=own)
        return repaired, np.where(wrong, passed, phase)

    def _piece(
        self,
        stamp_ns: int,
        cloud: _Cloud,
        coverage: Coverage | None,
        chosen: BoolArray | None = None,
    ) -> Piece:
        """Return a part with a stamp above those before it."""
        part = cloud.detections if chosen is None else cloud.detections.take(np.flatnonzero(chosen))
        stamp_ns = max(stamp_ns, self._last_piece_ns + 1)
        self._last_piece_ns = stamp_ns
        time_s = part.time_s
        if time_s is not None:
            time_s = time_s + (cloud.stamp_ns - stamp_ns) * 1e-9
        return stamp_ns, replace(part, time_s=time_s, coverage=coverage)


def _densest(phase: FloatArray, width: float) -> tuple[float, float]:
    """Return the first and the last phase of the interval of a width with the most of them."""
    ordered = np.sort(phase)
    last = np.searchsorted(ordered, ordered + width, side="right") - 1
    first = int(np.argmax(last - np.arange(len(ordered))))
    return float(ordered[first]), float(ordered[last[first]])


def _coverage(start: float, end: float, direction: int) -> Coverage:
    """Return the azimuths between two phases."""
    first = start if direction > 0 else -end
    width = min(max(end - start, NOTHING.width), FULL_TURN)
    return Coverage(math.remainder(first, FULL_TURN), width)
