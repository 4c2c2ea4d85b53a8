"""Tells a sensor's wrong clock from a jump of time.

The sensors are those of a tracker, or the trackers of a joint picture. Their stamps follow one
time. A stamp far from it means that time has jumped, because a recording starts again or has a gap,
or that the sensor's clock is wrong. The other sensors decide: the report is held back until they
have followed it or are silent, and it is left out if they go on as before. The larger number of
sensors is right. A sensor that no other contradicts confirms a jump by its next report.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, Protocol, TypeVar

from ..types import Detections

# Reason for which what is sent is left out: its stamp is far from those of other sensors.
CLOCK = "clock"
# Share of the longest delay by which a stamp may be ahead of those of other sensors.
AHEAD = 0.5


class Stamped(Protocol):
    """What a sensor sends."""

    @property
    def sensor(self) -> int:
        """The sensor's index in the configured order."""

    @property
    def stamp_ns(self) -> int:
        """Its stamp, nanoseconds."""


SentT = TypeVar("SentT", bound=Stamped)


class SentReport(NamedTuple):
    """A report as it was sent."""

    sensor: int
    stamp_ns: int
    detections: Detections
    sector: int | None = None  # Number of the sector; None if unknown


@dataclass(eq=False)
class _Clock(Generic[SentT]):
    """The stamps of one sensor."""

    last_ns: int | None = None  # Its latest stamp that follows the common time
    step_ns: int = 0  # Its latest interval
    # How far its latest stamp was ahead of the time of receipt; None if that is unknown.
    ahead_of_receipt_ns: int | None = None
    # Reports far from the common time, by ascending order of arrival, with their numbers in it.
    held: list[tuple[int, SentT]] = field(default_factory=list)
    # The stamp of the first of them, or of the last one before another sensor went on.
    alone_since_ns: int = 0
    alone: int = 0  # The number of its reports since then
    early: bool = False  # Whether its stamps are later than their receipt, unlike those of others
    # Whether other sensors went on without it, and it has not agreed with any since.
    contradicted: bool = False

    @property
    def weight(self) -> int:
        """Weight of the sensor against others."""
        return 1 if self.contradicted else 2

    def is_early(self, most_ns: float, others: Iterable[_Clock[SentT]]) -> bool:
        """Return whether its latest stamp is later than its receipt, and another's is not.

        `most_ns` is the largest difference that counts as none.
        """
        received = [each.ahead_of_receipt_ns for each in (self, *others)]
        known = [ahead_ns > most_ns for ahead_ns in received if ahead_ns is not None]
        return received[0] is not None and known[0] and not all(known)


class Clocks(Generic[SentT]):
    """Holds back and leaves out the reports whose stamps are far from those of other sensors.

    A stamp is far if it is behind the newest one by more than `reach_s`, which is the longest delay
    of a report, or ahead of it by more than half as much, since the others report too; and if it is
    later than its receipt by so much, while others' stamps are not. A sensor without others may be
    ahead by `max_gap_s`.
    """

    def __init__(self, sensors: int, reach_s: float, max_gap_s: float) -> None:
        self._reach_ns, self._gap_ns = reach_s * 1e9, max(reach_s, max_gap_s) * 1e9
        self._clocks: list[_Clock[SentT]] = [_Clock() for _ in range(sensors)]
        self._left_out: list[SentT] = []
        self._arrived = 0
        self._begin()

    def _begin(self) -> None:
        """Begin a time that no report follows yet."""
        self._newest_ns: int | None = None
        self._first_ns = 0  # The first stamp of this time
        self._latest = 0  # The sensor that reported last of those that follow the time
        self._followers: set[int] = set()

    def reset(self) -> None:
        """Forget all stamps, and leave out the reports that are held back."""
        for clock in self._clocks:
            self._leave_out(clock)
        self._clocks = [_Clock() for _ in self._clocks]
        self._begin()

    def take_left_out(self) -> list[SentT]:
        """Return the reports that were left out since the last call."""
        taken, self._left_out = self._left_out, []
        return taken

    def offset_s(self, sensor: int) -> float | None:
        """Return how far a sensor's stamps are ahead of those of others, seconds.

        It is None unless the sensor's reports are left out for it. The times of receipt give it
        more accurately than the stamps, if they agree with them.
        """
        own, other = self._clocks[sensor], self._clocks[self._latest]
        if not own.held or not own.contradicted or self._newest_ns is None:
            return None
        by_stamps = own.held[-1][1].stamp_ns - self._newest_ns
        if own.ahead_of_receipt_ns is not None and other.ahead_of_receipt_ns is not None:
            by_receipt = own.ahead_of_receipt_ns - other.ahead_of_receipt_ns
            if abs(by_receipt - by_stamps) <= self._reach_ns:
                return by_receipt * 1e-9
        return by_stamps * 1e-9

    def add(self, sent: SentT, received_ns: int | None = None) -> Sequence[SentT]:
        """Take in a report; return those that are due, in the order of arrival.

        `received_ns` is the time of receipt, if it is known. It shows which stamps are in the
        future, and which of two sensors is right where their stamps alone cannot tell.
        """
        own = self._clocks[sent.sensor]
        own.ahead_of_receipt_ns = None if received_ns is None else sent.stamp_ns - received_ns
        if self._is_near(sent) and not self._continues_jump_back(own, sent):
            # Time may have passed the first stamps that were ahead of it.
            since_ns = sent.stamp_ns if self._newest_ns is None else self._newest_ns
            until_ns = sent.stamp_ns + AHEAD * self._reach_ns
            passed = self._held_within(since_ns - self._reach_ns, until_ns, first=True)
            if own in passed and own.held[-1][1].stamp_ns > sent.stamp_ns:
                passed.remove(own)
            due = [*self._release(passed), sent]
            self._leave_out(own)
            # The first report of a sensor does not show that it goes on.
            if own.last_ns is not None:
                self._contradict_held()
            self._follow(due)
            return due
        if own.held and not self._continues(own.held[-1][1], sent):
            self._leave_out(own)
        if not own.held:
            own.alone_since_ns, own.alone = sent.stamp_ns, 0
        self._arrived += 1
        own.alone += 1
        own.held.append((self._arrived, sent))
        reach_ns = self._reach_ns
        group = self._held_within(sent.stamp_ns - reach_ns, sent.stamp_ns + reach_ns)
        others = [
            each for each in self._clocks if each not in group and self._goes_on(each, own, sent)
        ]
        if not own.early and self._has_jumped(own, group, others):
            return self._jump(group, bool(others))
        if own.contradicted:
            self._leave_out(own, keep=1)
        return ()

    def _is_near(self, sent: SentT) -> bool:
        """Return whether a report follows the common time."""
        if self._newest_ns is None:
            return True
        ahead_ns, own = sent.stamp_ns - self._newest_ns, self._clocks[sent.sensor]
        others = [each for each in self._others(sent.sensor) if self._is_live(each)]
        # Nobody can be ahead by more than an interval of another one that reports. The own interval
        # tells nothing, because that of a wrong clock may be any.
        most_ns = AHEAD * min(map(self._patience_ns, others), default=self._reach_ns)
        own.early = own.is_early(most_ns, others)
        most_ns = most_ns if others else self._gap_ns
        return -self._reach_ns <= ahead_ns <= most_ns and not own.early

    def _continues_jump_back(self, own: _Clock[SentT], sent: SentT) -> bool:
        """Return whether a report is behind an earlier one of its sensor, as those held back are.

        A short recording that starts again comes near its end after a few reports.
        """
        if not own.held or own.last_ns is None:
            return False
        return sent.stamp_ns <= own.last_ns and self._continues(own.held[-1][1], sent)

    def _others(self, sensor: int) -> list[_Clock[SentT]]:
        return [clock for index, clock in enumerate(self._clocks) if index != sensor]

    def _is_live(self, clock: _Clock[SentT]) -> bool:
        """Return whether a sensor follows the common time, and is not silent."""
        if clock.held or clock.last_ns is None or self._newest_ns is None:
            return False
        return self._newest_ns - clock.last_ns <= self._patience_ns(clock)

    def _patience_ns(self, clock: _Clock[SentT]) -> float:
        """Return the time after which a sensor is silent."""
        # A sensor is silent after this number of its intervals.
        return max(self._reach_ns, 2 * clock.step_ns)

    def _continues(self, before: SentT, sent: SentT) -> bool:
        """Return whether a report comes after another one of the same sensor and time."""
        step_ns = sent.stamp_ns - before.stamp_ns
        return step_ns != 0 and -self._reach_ns <= step_ns <= self._gap_ns

    def _held_within(
        self, since_ns: float, until_ns: float, first: bool = False
    ) -> list[_Clock[SentT]]:
        """Return the sensors of whose held reports the latest, or the first, is in an interval."""
        which = 0 if first else -1
        held = [clock for clock in self._clocks if clock.held and not clock.early]
        return [each for each in held if since_ns <= each.held[which][1].stamp_ns <= until_ns]

    def _goes_on(self, clock: _Clock[SentT], own: _Clock[SentT], sent: SentT) -> bool:
        """Return whether a sensor may still go on as before, by the time that `own` waits.

        One report shows no time, because the stamps of a wrong clock may be anywhere.
        """
        waited_ns = sent.stamp_ns - own.alone_since_ns
        is_soon = own.alone < 2 or waited_ns <= self._patience_ns(clock)
        return self._is_live(clock) and is_soon

    def _has_jumped(
        self, own: _Clock[SentT], group: list[_Clock[SentT]], others: list[_Clock[SentT]]
    ) -> bool:
        """Return whether the sensors of a group, `own` among them, are right against the others."""
        if not others:
            # Sensors that are late reach the time by themselves.
            late = all(each.contradicted for each in group) and self._is_behind(own)
            return not late and (len(group) > 1 or len(own.held) > 1)
        difference = sum(each.weight for each in group) - sum(each.weight for each in others)
        return difference > 0 or (difference == 0 and self._is_likelier(own))

    def _is_behind(self, own: _Clock[SentT]) -> bool:
        """Return whether a sensor is behind the time by less than a gap in it."""
        if self._newest_ns is None:
            return False
        return 0 < self._newest_ns - own.held[-1][1].stamp_ns <= self._gap_ns

    def _is_likelier(self, own: _Clock[SentT]) -> bool:
        """Return whether one of two sensors that never agreed is right, and not the first one.

        It is if only its stamps are near the times of receipt. Otherwise, at the start, the earlier
        time is right, because GPS and atomic time, which are sent instead of UTC, are ahead of it,
        unless it is earlier by years: then it is of a clock that was never set.
        """
        if len(self._followers) > 1 or self._newest_ns is None:
            return False
        ahead = (own.ahead_of_receipt_ns, self._clocks[self._latest].ahead_of_receipt_ns)
        own_near, near = (each is not None and abs(each) <= self._reach_ns for each in ahead)
        if own_near != near:
            return own_near
        is_start = self._newest_ns - self._first_ns <= self._reach_ns
        ahead_ns = own.held[-1][1].stamp_ns - self._newest_ns
        # The time of a clock that was never set, which counts from 1970 or from its start, is
        # earlier than others by more than this, two years.
        return is_start and (ahead_ns < 0) != (abs(ahead_ns) > 6.3e16)

    def _jump(self, group: list[_Clock[SentT]], against_others: bool) -> list[SentT]:
        """Follow the time of a group; return its reports that were held back."""
        since_ns = self._newest_ns
        self._begin()
        for clock in self._clocks:
            clock.last_ns = None
        # A sensor that takes over because others are silent does not become right by that.
        if against_others:
            for clock in group:
                clock.contradicted = False
        newest_ns = max(clock.held[-1][1].stamp_ns for clock in group)
        if since_ns is not None and since_ns < newest_ns:
            # What is between was right too.
            group = [*group, *(c for c in self._held_within(since_ns, newest_ns) if c not in group)]
        due = self._release(group)
        self._follow(due)
        return due

    def _release(self, clocks: Collection[_Clock[SentT]]) -> list[SentT]:
        """Hold back the reports of sensors no longer; return them."""
        held = sorted(each for clock in clocks for each in clock.held)
        for clock in clocks:
            clock.held = []
        return [sent for _, sent in held]

    def _follow(self, due: Iterable[SentT]) -> None:
        """Note reports that follow the common time."""
        for sent in due:
            own, stamp_ns = self._clocks[sent.sensor], sent.stamp_ns
            if own.contradicted and any(self._is_live(each) for each in self._others(sent.sensor)):
                own.contradicted = False
            if own.last_ns is not None and stamp_ns > own.last_ns:
                own.step_ns = stamp_ns - own.last_ns
            own.last_ns = stamp_ns if own.last_ns is None else max(own.last_ns, stamp_ns)
            if self._newest_ns is None:
                self._newest_ns = self._first_ns = stamp_ns
            self._newest_ns = max(self._newest_ns, stamp_ns)
            self._latest = sent.sensor
            self._followers.add(sent.sensor)

    def _contradict_held(self) -> None:
        """Note that a sensor follows the common time while others' reports are held back."""
        for clock in self._clocks:
            if clock.held:
                clock.contradicted = True
                clock.alone_since_ns, clock.alone = clock.held[-1][1].stamp_ns, 0
                self._leave_out(clock, keep=1)

    def _leave_out(self, clock: _Clock[SentT], keep: int = 0) -> None:
        """Leave out a sensor's held reports but the latest ones."""
        first = max(len(clock.held) - keep, 0)
        self._left_out += [sent for _, sent in clock.held[:first]]
        del clock.held[:first]
