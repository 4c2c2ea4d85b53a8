"""Joins several trackers' filtered and smoothed estimates into one picture, live and offline.

Estimates go in one by one, and come out joined, stamp by stamp. Stamps define time; the time of
arrival does not matter, so that delays of topics do not change the result. A stamp is closed when
every tracker has reported it or a later one. It waits at most for the longest delay: when the
newest stamp is later by more, the stamp is overdue, and the trackers that have not reached it are
silent. The others do not wait for a silent tracker until it reports a recent stamp.

`Handover` numbers the filtered estimates. Smoothed ones get the numbers of the same tracks at their
stamp or shortly after it, because the smoother reports a target before the filter has confirmed it.
They wait until the filtered picture is ahead of them by that time.

A new run begins when the filtered stamps of a tracker go back. The other trackers' stamps do not go
back at the same instant; their remaining estimates of the earlier run are recognised.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, SOURCES, Estimates

from .ownership import REACH, Handover, Numbers

# Estimates of one stamp, by the index of their tracker.
Gathered = Mapping[int, Estimates]
# If the number of waiting stamps is bounded, so is their mean number of targets.
TARGETS_OF_A_STAMP = 100


def too_many(waiting: Collection[Gathered], most: int | None) -> bool:
    """Return whether too many stamps, or too many targets with them, wait; one stamp always may."""
    if most is None or len(waiting) < 2:
        return False
    targets = sum(len(own) for gathered in waiting for own in gathered.values())
    return len(waiting) > most or targets > most * TARGETS_OF_A_STAMP


class Refusal(Enum):
    """Reason why estimates are refused."""

    DUPLICATE = "duplicate"
    LATE = "late"


@dataclass
class Gathering:
    """Gathers the filtered or the smoothed estimates of one run."""

    trackers: int  # Number of trackers
    # Longest time by which a waiting stamp may be behind the newest one, seconds; infinite for
    # recordings, which are complete.
    longest_delay_s: float
    # Upper bound of the waiting stamps (see `too_many`), above which the oldest is closed; None for
    # no bound.
    most_waiting: int | None = None
    # Number of stamps that were closed because too many waited.
    overflow: int = field(init=False, default=0)
    _pending: dict[int, dict[int, Estimates]] = field(init=False, default_factory=dict)
    _latest: dict[int, int] = field(init=False, default_factory=dict)
    _interval: dict[int, int] = field(init=False, default_factory=dict)
    _first_ns: int | None = field(init=False, default=None)
    _closed_ns: int | None = field(init=False, default=None)
    # Known stamps that are not overdue, ascending; and the newest overdue one.
    _recent: list[int] = field(init=False, default_factory=list)
    _overdue_ns: int | None = field(init=False, default=None)
    _silent: set[int] = field(init=False, default_factory=set)

    @property
    def silent(self) -> frozenset[int]:
        """Indices of the silent trackers."""
        return frozenset(self._silent)

    @property
    def newest_ns(self) -> int:
        """The newest stamp of any tracker; 0 before the first."""
        return max(self._latest.values(), default=0)

    def latest_ns(self, tracker: int) -> int | None:
        """Return a tracker's latest stamp, even a refused one; None before its first."""
        return self._latest.get(tracker)

    def expected_ns(self, at_most_ns: float = math.inf) -> dict[int, float]:
        """Return the latest stamp whose estimates may still arrive from each tracker, nanoseconds.

        It is the tracker's latest stamp plus its last interval plus the longest delay. Trackers
        without estimates are omitted.
        """
        longest_ns = self.longest_delay_s * 1e9
        return {
            tracker: min(latest + self._interval.get(tracker, 0) + longest_ns, at_most_ns)
            for tracker, latest in self._latest.items()
        }

    def behind_s(self, tracker: int) -> float:
        """Return the age of a tracker's latest stamp relative to the newest of all, seconds.

        For a tracker without estimates it is the age of the first stamp.
        """
        if self._first_ns is None:
            return 0.0
        return (self.newest_ns - self._latest.get(tracker, self._first_ns)) * 1e-9

    def jumps_back(self, tracker: int, stamp_ns: int) -> bool:
        """Return whether a stamp is older than the tracker's latest one."""
        return stamp_ns < self._latest.get(tracker, stamp_ns)

    def add(self, tracker: int, found: Estimates) -> list[Gathered] | Refusal:
        """Add the estimates of a tracker; return the stamps that are now closed, oldest first.

        They are without the trackers that have no estimates of them. Estimates are refused if their
        stamp is closed already, or the tracker has reported it before.
        """
        stamp = found.stamp_ns
        if stamp == self._latest.get(tracker) or tracker in self._pending.get(stamp, {}):
            return Refusal.DUPLICATE
        self._record(tracker, stamp)
        if self._closed_ns is not None and stamp <= self._closed_ns:
            return Refusal.LATE
        self._pending.setdefault(stamp, {})[tracker] = found
        # The newest tracker is never silent, so at least one is awaited.
        awaited = [self._latest.get(k) for k in range(self.trackers) if k not in self._silent]
        until = None if None in awaited else min(stamp for stamp in awaited if stamp is not None)
        closed = [] if until is None else self._close(until)
        while too_many(self._pending.values(), self.most_waiting):
            self.overflow += 1
            closed += self._close(min(self._pending))
        return closed

    def close_all(self) -> list[Gathered]:
        """Close all stamps, oldest first."""
        return self._close(max(self._pending, default=0))

    def _record(self, tracker: int, stamp: int) -> None:
        """Record a tracker's stamp, and update the silent trackers."""
        before = self._latest.get(tracker, stamp)
        if stamp > before:
            self._interval[tracker] = stamp - before
        self._latest[tracker] = max(stamp, before)
        self._first_ns = stamp if self._first_ns is None else self._first_ns
        place = bisect_left(self._recent, stamp)
        is_new = stamp not in self._recent[place : place + 1]
        if is_new and (self._overdue_ns is None or stamp > self._overdue_ns):
            self._recent.insert(place, stamp)
            if self.most_waiting is not None and len(self._recent) > self.most_waiting:
                self._recent.pop(0)
        newest, longest_ns = self.newest_ns, self.longest_delay_s * 1e9
        while newest - self._recent[0] > longest_ns:
            self._overdue_ns = self._recent.pop(0)
        if newest - stamp <= longest_ns:
            self._silent.discard(tracker)
        overdue = self._overdue_ns
        if overdue is not None:
            # A tracker without estimates has not reached any stamp.
            self._silent.update(
                k for k in range(self.trackers) if self._latest.get(k, overdue - 1) < overdue
            )

    def _close(self, until_ns: int) -> list[Gathered]:
        stamps = sorted(stamp for stamp in self._pending if stamp <= until_ns)
        self._closed_ns = stamps[-1] if stamps else self._closed_ns
        return [self._pending.pop(stamp) for stamp in stamps]


# Largest number of targets of one stamp, which bounds work and memory.
MOST_TARGETS = 10_000


def fault_of(found: Estimates) -> tuple[str, str] | None:
    """Return why estimates cannot be joined, as a key and a sentence; None if they can.

    Tracks must have unique numbers. Covariances of position and velocity must be positive
    semidefinite, because a distance between two estimates is undefined otherwise. There may be at
    most `MOST_TARGETS` of them.
    """
    # Matching adds this to each axis; half of it belongs to each estimate.
    slack = 0.5
    if len(found) > MOST_TARGETS:
        return "oversize", f"{len(found)} targets, at most {MOST_TARGETS} are allowed"
    tracks, counts = np.unique(found.track_id, return_counts=True)
    if (tracks <= 0).any():
        count = int(counts[tracks <= 0].sum())
        return "unlabelled", (
            f"{count} of {len(found)} targets have track_id 0, must be above 0: a tracker with "
            "engine: phd has no tracks"
        )
    if (counts > 1).any():
        return "schema", f"track_id {tracks[counts > 1][0]} is given twice, must be once"
    axes = [*found.space.position, *found.space.velocity]
    covariance = found.covariance[:, axes][:, :, axes]
    variance = np.einsum("tii->ti", covariance)
    lowest = np.full(len(found), -np.inf)
    usable = (variance >= 0.0).all(axis=1)
    scale = np.sqrt(variance[usable] + slack)
    whole = covariance[usable] + slack * np.eye(len(axes))
    lowest[usable] = np.linalg.eigvalsh(whole / (scale[:, :, None] * scale[:, None]))[:, 0]
    # FLOAT32 rounding does not make an eigenvalue of a correlation matrix smaller than this.
    bad = np.flatnonzero(lowest < -1e-6)
    if len(bad):
        return "covariance", (
            f"the covariance of track {found.track_id[bad[0]]} has a negative eigenvalue, must be "
            "positive semidefinite"
        )
    return None


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
