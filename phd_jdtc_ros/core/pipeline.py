# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pipeline from reports to estimates, which the live node and the offline tracker share.

Reports are grouped into scans, scans step the engine, and jumps of the stamps end runs. The live
node publishes the estimates, and the offline tracker writes them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from .configuration.build import TrackerConfig
from .engine import Engine, Step
from .engines import new_engine
from .scans import Rejection, Reset, ScanGrouper
from .types import Detections, Estimates, Scan


@dataclass(frozen=True)
class Stepped:
    """The engine has stepped through a scan."""

    scan: Scan
    step: Step


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
    """

    def __init__(
        self,
        grouper: ScanGrouper,
        engine: Engine,
        begin: Callable[[Engine, int], None] = _start_cold,
    ) -> None:
        self.engine = engine
        self._grouper = grouper
        self._begin = begin
        self._begun = False

    @property
    def waiting(self) -> bool:
        """Whether a report is held back because its scan is not complete."""
        return self._grouper.waiting

    def add(self, radar: int, stamp_ns: int, detections: Detections) -> Iterator[Event] | Rejection:
        """Add one report.

        Parameters
        ----------
        radar : int
            Index in the configured order.
        stamp_ns : int
        detections : Detections

        Returns
        -------
        iterator of Event
        Rejection
            If the report is not part of any scan.
        """
        closed = self._grouper.add(radar, stamp_ns, detections)
        return closed if isinstance(closed, Rejection) else self._events(closed)

    def close_scans(self) -> Iterator[Event]:
        """Close all scans, complete or not, and step the engine through them."""
        return self._events(self._grouper.close_all())

    def flush(self) -> Iterator[Event]:
        """Close all scans, step the engine through them, and end the run."""
        yield from self.close_scans()
        self._grouper.reset()
        yield self._end(None)

    def reset(self) -> None:
        """Discard all scans and return the engine to its initial state."""
        self._grouper.reset()
        self.engine.reset()
        self._begun = False

    def _events(self, closed: Sequence[Scan | Reset]) -> Iterator[Event]:
        for event in closed:
            if isinstance(event, Reset):
                yield self._end(event)
                continue
            if not self._begun:
                self._begin(self.engine, event.stamp_ns)
                self._begun = True
            yield Stepped(event, self.engine.step(event))

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
    return Pipeline(config.grouper(), new_engine(config), begin)
