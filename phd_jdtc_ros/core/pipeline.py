# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pipeline from reports to estimates, which the live node and the offline tracker share.

Reports of turning radars are cut into slices, those of moving radars get the poses that they were
measured from, reports are grouped into scans, scans step the engine, and jumps of the stamps end
runs. The live node publishes the estimates, and the offline
tracker writes them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from .configuration.build import TrackerConfig
from .engine import Engine, Step
from .engines import new_engine
from .posed_reports import PosedReports
from .poses import Platform, PoseFault
from .scans import Rejection, Reset, ScanGrouper
from .turns import Turns
from .types import Detections, Estimates, Pose, Scan
from .watch import ReportWatch, ResultWatch


@dataclass(frozen=True)
class Stepped:
    """The engine has stepped through a scan.

    Parameters
    ----------
    scan : Scan
    step : Step
    overdue : int
        Number of scans with detections since there was a target, when that is worth a warning.
    """

    scan: Scan
    step: Step
    overdue: int = 0


@dataclass(frozen=True)
class RunEnded:
    """The stamps jumped, or the run was flushed; later events belong to a new run.

    Parameters
    ----------
    reset : Reset or None
        The jump; None if the run was flushed.
    smoothed : tuple of Estimates
        Estimates that were held back, oldest first.
    """

    reset: Reset | None
    smoothed: tuple[Estimates, ...]


# Why a report of a moving radar is not used: where the radar was is not known.
POSE_MISSING = "pose_missing"

Event: TypeAlias = "Stepped | RunEnded"


def _start_cold(engine: Engine, stamp_ns: int) -> None:
    """Leave the engine in its initial state."""


class Pipeline:
    """Groups reports into scans and steps the engine through them.

    Its methods return iterators: a scan is stepped when its event is requested, so that its
    estimates can be published before the next scan is stepped. Every iterator must be exhausted
    before the next call.

    Parameters
    ----------
    grouper : ScanGrouper
    engine : Engine
    begin : callable
        Called with the engine and the stamp of a run's first scan before that scan is stepped; it
        may restore the engine.
    turns : sequence of Turns
        What cuts each radar's reports, in the configured order; empty if nothing is to be cut.
    watches : sequence of ReportWatch
        What watches each radar's reports, in the configured order; empty for nothing.
    results : ResultWatch or None
    platforms : sequence of (Platform or None)
        What carries each radar, in the configured order, None for one that stands; empty if none
        of them moves.
    """

    def __init__(
        self,
        grouper: ScanGrouper,
        engine: Engine,
        begin: Callable[[Engine, int], None] = _start_cold,
        turns: Sequence[Turns] = (),
        watches: Sequence[ReportWatch] = (),
        results: ResultWatch | None = None,
        platforms: Sequence[Platform | None] = (),
    ) -> None:
        self.engine = engine
        self._turns = tuple(turns) or tuple(Turns() for _ in range(grouper.radars))
        self._watches = tuple(watches) or tuple(ReportWatch() for _ in range(grouper.radars))
        self._results = results or ResultWatch(math.inf)
        self._grouper = grouper
        self._posed = PosedReports(platforms)
        self._drops: list[Counter[str]] = [Counter() for _ in range(grouper.radars)]
        self._begin = begin
        self._begun = False

    @property
    def waiting(self) -> bool:
        """Whether a report is held back: its scan is not complete, or its pose is not known."""
        return self._grouper.waiting or self._posed.waiting

    def add(
        self, radar: int, stamp_ns: int, detections: Detections, sector: int | None = None
    ) -> Iterator[Event] | Rejection:
        """Add one report.

        Parameters
        ----------
        radar : int
            Index in the configured order.
        stamp_ns : int
        detections : Detections
        sector : int or None
            Number of the sector, if the report says it.

        Returns
        -------
        iterator of Event
        Rejection
            If no part of the report is part of any scan.
        """
        turns = self._turns[radar]
        turns.doubts += self._watches[radar].add(detections)
        pieces = turns.split(stamp_ns, detections, sector)
        if isinstance(pieces, Rejection):
            return pieces
        if self._posed.moving:
            self._posed.add(radar, pieces)
            return self._events(self._released())
        closed: list[Scan | Reset] = []
        rejected = []
        for piece_ns, piece in pieces:
            found = self._grouper.add(radar, piece_ns, piece)
            if isinstance(found, Rejection):
                rejected.append(found)
            else:
                closed += found
        if len(rejected) == len(pieces):
            return rejected[0]
        turns.doubts["slices_late"] += len(rejected)
        return self._events(closed)

    def add_pose(self, radar: int, stamp_ns: int, pose: Pose) -> Iterator[Event] | PoseFault:
        """Add a pose of what carries a radar.

        Parameters
        ----------
        radar : int
            Index in the configured order, of a radar that moves.
        stamp_ns : int
        pose : Pose

        Returns
        -------
        iterator of Event
            Of the scans that waited for it.
        PoseFault
            If the pose is not used.
        """
        fault = self._posed.add_pose(radar, stamp_ns, pose)
        return fault if fault is not None else self._events(self._released())

    def take_drops(self, radar: int) -> Counter[str]:
        """Return what of a radar's reports was not used after `add`, counted since the last call.

        Reports of moving radars wait for their poses, so that it is not known earlier.
        """
        taken, self._drops[radar] = self._drops[radar], Counter()
        return taken

    def _released(self, everything: bool = False) -> list[Scan | Reset]:
        """Return what the reports close that no longer wait for their poses, or all reports."""
        closed: list[Scan | Reset] = []
        for report in self._posed.released(everything):
            if report.detections is None:
                self._drops[report.radar][POSE_MISSING] += 1
                continue
            if report.extrapolated:
                self._turns[report.radar].doubts["poses_extrapolated"] += 1
            found = self._grouper.add(report.radar, report.stamp_ns, report.detections)
            if isinstance(found, Rejection):
                self._drops[report.radar][found.value] += 1
            else:
                closed += found
        return closed

    def take_doubts(self, radar: int) -> Counter[str]:
        """Return what was bridged or noticed in a radar's reports since the last call, counted."""
        doubts = self._turns[radar].doubts
        taken = +doubts
        doubts.clear()
        return taken

    def close_scans(self) -> Iterator[Event]:
        """Close all scans, complete or not, and step the engine through them."""
        return self._events([*self._released(everything=True), *self._grouper.close_all()])

    def flush(self) -> Iterator[Event]:
        """Close all scans, step the engine through them, and end the run."""
        yield from self.close_scans()
        self._forget_stamps()
        yield self._end(None)

    def reset(self) -> None:
        """Discard all scans and return the engine to its initial state."""
        self._forget_stamps()
        self.engine.reset()
        self._begun = False

    def _forget_stamps(self) -> None:
        self._grouper.reset()
        self._posed.forget()
        for turns in self._turns:
            turns.reset()

    def _events(self, closed: Sequence[Scan | Reset]) -> Iterator[Event]:
        for event in closed:
            if isinstance(event, Reset):
                yield self._end(event)
                continue
            if not self._begun:
                self._begin(self.engine, event.stamp_ns)
                self._begun = True
            step = self.engine.step(event)
            overdue = self._results.stepped(event, step)
            yield Stepped(event, step, self._results.scans if overdue else 0)

    def _end(self, reset: Reset | None) -> RunEnded:
        """End the run; after a jump ahead, no track number is used a second time."""
        ahead = reset is not None and reset.ahead
        rest = self.engine.interrupt() if ahead else self.engine.flush()
        self._begun = False
        return RunEnded(reset, rest)


def new_pipeline(
    config: TrackerConfig, begin: Callable[[Engine, int], None] = _start_cold
) -> Pipeline:
    """Return a pipeline with a new engine; `begin` is that of `Pipeline`."""
    return Pipeline(
        config.grouper(),
        new_engine(config),
        begin,
        config.turns(),
        config.watches(),
        ResultWatch(config.model.modes.interval_s),
        config.platforms(),
    )
