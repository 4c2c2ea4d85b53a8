"""Joins several trackers' filtered and smoothed estimates into one picture, live and offline.

Estimates go in one by one, and come out joined, stamp by stamp. `Handover` numbers the filtered
ones. Smoothed ones get the numbers of the same tracks at their stamp or shortly after it, because
the smoother reports a target before the filter has confirmed it. They wait until the filtered
picture is ahead of them by that time.

A new run begins when the filtered stamps of a tracker go back. The other trackers' stamps do not go
back at the same instant; their remaining estimates of the earlier run are recognised.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES, Estimates

from .ownership import REACH, Handover, Numbers
from .synchroniser import Gathered, Gathering, Refusal, too_many

# Track numbers of messages are less than this.
SERIES = 2**32
# Time for which the beginning of a series is remembered, seconds.
KEPT_S = 600.0


class TrackSeries:
    """The series of one tracker's track numbers."""

    def __init__(self) -> None:
        self._count = 0
        # Stamp after which each recent series began, ascending, and the series' number.
        self._series: list[tuple[int, int]] = []
        self._highest = 0
        self._newest: Estimates | None = None
        self._last_ns = 0

    def take(self, stamp_ns: int, found: Estimates | None) -> None:
        """Add the filtered estimates of a stamp, None if the tracker has none; stamps increase."""
        before = self._newest
        if found is None:
            # After this silence the tracks of a tracker cannot be matched with the earlier ones,
            # seconds.
            if before is not None and stamp_ns - before.stamp_ns > 60.0 * 1e9:
                self._newest = None
            return
        self._newest = found
        if not len(found):
            return
        continues = before is not None and _continues(before, found)
        if not continues and int(found.track_id.min()) <= self._highest:
            self._count += 1
            # Everything after the last track of the earlier series belongs to this one, because
            # the smoother reports a target before the filter does.
            self._series.append((self._last_ns, self._count))
            self._highest = 0
        self._highest = max(self._highest, int(found.track_id.max()))
        self._last_ns = stamp_ns
        oldest_ns = stamp_ns - round(KEPT_S * 1e9)
        self._series = [entry for entry in self._series if entry[0] >= oldest_ns]

    def renumber(self, found: Estimates) -> Estimates:
        """Return estimates with track numbers that are unique over all series."""
        if not self._count:
            return found
        series = self._series[0][1] - 1 if self._series else self._count
        for after_ns, number in self._series:
            series = number if found.stamp_ns > after_ns else series
        return replace(found, track_id=found.track_id + SERIES * series)


def _continues(before: Estimates, found: Estimates) -> bool:
    """Return whether most tracks are near the earlier track with the same number."""
    _, old, new = np.intersect1d(before.track_id, found.track_id, return_indices=True)
    moved = np.hypot(*(found.position[new] - before.position[old]).T)
    speed = np.maximum(np.hypot(*before.velocity[old].T), np.hypot(*found.velocity[new].T))
    flown = speed * (found.stamp_ns - before.stamp_ns) * 1e-9
    near = np.count_nonzero(moved <= REACH + flown)
    # After a restart, a target may get its earlier number by chance.
    return bool(2 * near > len(moved))


# Window of stamps in which most must have estimates of all live trackers; otherwise the trackers
# have no common stamps.
LATEST_STAMPS = 10

# Source, filtered or smoothed, and joint estimates.
Joint = tuple[str, Estimates]


@dataclass
class _Run:
    """A run: estimates whose stamps do not go back."""

    gatherings: Mapping[str, Gathering]
    series: Sequence[TrackSeries]
    numbers: Numbers
    # Smoothed estimates that wait for their numbers.
    smoothed: list[Gathered] = field(default_factory=list)
    # Stamp of the filtered picture; infinite after the end of the run.
    reached_ns: float = -math.inf
    # Latest stamp of an ended run of which estimates may still arrive, by tracker.
    until_ns: Mapping[int, float] = field(default_factory=dict)
    closed: bool = False  # True if further smoothed estimates are too late

    def renumber(self, gathered: Gathered) -> Gathered:
        """Return estimates of a stamp with track numbers that are unique in the run."""
        return {tracker: self.series[tracker].renumber(own) for tracker, own in gathered.items()}


class JointPicture:
    """Joins the estimates of trackers with adjacent regions; see `Handover` and `Gathering`.

    Smoothed estimates get their numbers when the filtered picture is ahead by `wait_s`;
    `most_waiting` also bounds the smoothed stamps that wait for that.
    """

    def __init__(
        self,
        regions: Sequence[Region],
        hysteresis: float,
        wait_s: float,
        longest_delay_s: float,
        most_waiting: int | None = None,
    ) -> None:
        self._handover = Handover(regions, hysteresis)
        self._trackers = range(len(regions))
        self._wait_ns = round(wait_s * 1e9)
        self._longest_delay_s, self._most_waiting = longest_delay_s, most_waiting
        self._run = self._new_run()
        self._previous = self._new_run()
        self._common: deque[bool] = deque(maxlen=LATEST_STAMPS)
        self._overflow = 0

    def _new_run(self) -> _Run:
        count = len(self._trackers)
        limits = self._longest_delay_s, self._most_waiting
        gatherings = {source: Gathering(count, *limits) for source in SOURCES}
        return _Run(gatherings, [TrackSeries() for _ in range(count)], Numbers(self._wait_ns))

    @property
    def silent(self) -> frozenset[int]:
        """Indices of the trackers that the filtered picture does not wait for."""
        return self._run.gatherings[FILTERED].silent

    @property
    def handed_over(self) -> int:
        """Number of times that a target was handed over from one tracker to another."""
        return self._handover.handed_over

    @property
    def uncommon_stamps(self) -> int:
        """Number of the last `LATEST_STAMPS` stamps at which a live tracker sent no estimates."""
        return self._common.count(False)

    @property
    def overflow(self) -> int:
        """Number of stamps that were closed incomplete because too many waited."""
        gatherings = self._run.gatherings.values()
        return self._overflow + sum(each.overflow for each in gatherings)

    def behind_s(self, tracker: int) -> float:
        """Return the age of a tracker's filtered estimates relative to the newest, seconds."""
        return self._run.gatherings[FILTERED].behind_s(tracker)

    def jumps_back(self, tracker: int, source: str, stamp_ns: int) -> bool:
        """Return whether `add` of such estimates would begin a new run."""
        return (
            source == FILTERED
            and not self._belongs_to_previous(tracker, source, stamp_ns)
            and self._run.gatherings[FILTERED].jumps_back(tracker, stamp_ns)
        )

    def add(self, tracker: int, source: str, found: Estimates) -> list[Joint] | Refusal:
        """Add the filtered or smoothed estimates of a tracker, which pass `synchroniser.fault_of`.

        Returns the joint estimates that are now complete, in the order of time for each source and
        run; or why these estimates are refused.
        """
        if self._belongs_to_previous(tracker, source, found.stamp_ns):
            return self._add_to_previous(tracker, source, found)
        done = []
        if self.jumps_back(tracker, source, found.stamp_ns):
            done = self._begin(self._run.gatherings[FILTERED].expected_ns())
        closed = self._run.gatherings[source].add(tracker, found)
        if isinstance(closed, Refusal):
            return closed
        if source == FILTERED:
            return done + self._join_filtered(closed)
        self._run.smoothed += closed
        if all(self._run.gatherings[SMOOTHED].latest_ns(k) is not None for k in self._trackers):
            done += self._close_previous()
        return done + self._join_smoothed(self._run)

    def close_all(self) -> list[Joint]:
        """Return all pending estimates, and begin a new run; numbers are not reused."""
        filtered = self._run.gatherings[FILTERED]
        # Stamps may go on: estimates after the newest stamp belong to the new run.
        done = self._begin(filtered.expected_ns(filtered.newest_ns))
        self._previous.smoothed += self._previous.gatherings[SMOOTHED].close_all()
        return done + self._join_smoothed(self._previous)

    def _begin(self, until_ns: Mapping[int, float]) -> list[Joint]:
        """Begin a new run; the current one accepts no more filtered estimates."""
        ended = self._run
        done = self._close_previous() + self._join_filtered(ended.gatherings[FILTERED].close_all())
        ended.reached_ns, ended.until_ns = math.inf, until_ns
        self._overflow += sum(each.overflow for each in ended.gatherings.values())
        self._previous, self._run = ended, self._new_run()
        self._handover.forget()
        return done + self._join_smoothed(ended)

    def _belongs_to_previous(self, tracker: int, source: str, stamp_ns: int) -> bool:
        """Return whether estimates belong to the previous run.

        Topics are not ordered relative to each other: a tracker's last estimates may arrive after
        another tracker's stamps have jumped back.
        """
        previous, gatherings = self._previous, self._run.gatherings
        if gatherings[source].latest_ns(tracker) is not None:
            return False
        if stamp_ns > previous.until_ns.get(tracker, -math.inf):
            return False
        # A tracker's first smoothed estimates belong to the new run if it has filtered their stamp
        # in it.
        latest = previous.gatherings[source].latest_ns(tracker)
        if latest is None:
            latest = gatherings[FILTERED].latest_ns(tracker)
        return latest is None or stamp_ns > latest

    def _add_to_previous(
        self, tracker: int, source: str, found: Estimates
    ) -> list[Joint] | Refusal:
        """Add estimates of the previous run; smoothed ones still get its numbers."""
        previous = self._previous
        closed = previous.gatherings[source].add(tracker, found)
        if isinstance(closed, Refusal):
            return closed
        if source == FILTERED or previous.closed:
            return Refusal.LATE
        previous.smoothed += closed
        return self._join_smoothed(previous)

    def _close_previous(self) -> list[Joint]:
        """Return the pending estimates of the previous run, which accepts no more."""
        previous = self._previous
        previous.smoothed += previous.gatherings[SMOOTHED].close_all()
        previous.closed = True
        return self._join_smoothed(previous)

    def _join_filtered(self, closed: Sequence[Gathered]) -> list[Joint]:
        """Return the joint filtered estimates of stamps, and the smoothed ones that are now due."""
        run, done = self._run, []
        live = set(self._trackers) - self.silent
        for gathered in closed:
            stamp_ns = next(iter(gathered.values())).stamp_ns
            self._common.append(live.issubset(gathered))
            for tracker, series in enumerate(run.series):
                series.take(stamp_ns, gathered.get(tracker))
            joint = self._handover.add(run.renumber(gathered))
            run.numbers.add(stamp_ns, self._handover.numbers)
            run.reached_ns = stamp_ns
            done.append((FILTERED, joint))
            done += self._join_smoothed(run)
        return done

    def _join_smoothed(self, run: _Run) -> list[Joint]:
        """Return a run's smoothed estimates that the filtered picture is far enough ahead of."""
        done: list[Joint] = []
        while run.smoothed:
            stamp_ns = next(iter(run.smoothed[0].values())).stamp_ns
            early = stamp_ns + self._wait_ns > run.reached_ns
            if early and not too_many(run.smoothed, self._most_waiting):
                break
            gathered = run.renumber(run.smoothed.pop(0))
            joint = self._handover.join_numbered(gathered, run.numbers.at(stamp_ns))
            done.append((SMOOTHED, joint))
        # The previous run's estimates come first.
        return self._close_previous() + done if done and run is self._run else done
