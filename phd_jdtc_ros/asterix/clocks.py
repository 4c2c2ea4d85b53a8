"""Converts times of day to times since the epoch.

A message has no date. It gets the date that brings its time nearest to its receipt or, in a
recording without times of receipt, to the radar's previous message. Any number of midnights can
pass in a recording.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from .messages import DAY, NONE, TICKS_PER_S

NS_PER_TICK = 10**9 // TICKS_PER_S
NS_PER_DAY = DAY * NS_PER_TICK
# A clock error must show in this many consecutive messages, because a single one may be delayed.
LEAST_OFF = 3
# Number of first messages whose median gives the clock error.
FIRST = 15
# Latest time that fits a stamp, which has 31 bits of seconds since 1970, less a day of margin
# because a slice ends after its plots.
LAST_NS = (2**31 - 1) * 10**9 - NS_PER_DAY


def fits_stamp(time_ns: int) -> bool:
    """Return whether a time fits a stamp."""
    return 0 <= time_ns <= LAST_NS


@dataclass
class StreamClock:
    """Dates the messages of all radars of a stream.

    Attributes
    ----------
    offset_s : dict of radar to float
        Receipt of each radar's latest message minus its unshifted time.
    shift_ns : dict of radar to int
        Correction that is added to the times of radars with wrong clocks.
    """

    # Beginning of the day of the first message; used if its time of receipt is unknown.
    midnight_ns: int = 0
    # Largest tolerated clock error, seconds. A larger error is estimated and removed from the
    # radar's times.
    max_offset_s: float = 10.0
    offset_s: dict[int, float] = field(init=False, default_factory=dict)
    shift_ns: dict[int, int] = field(init=False, default_factory=dict)
    _last_ns: dict[int, int] = field(init=False, default_factory=dict)
    _latest_ns: int | None = field(init=False, default=None)
    # Latest consecutive errors of each radar's clock beyond its present shift.
    _recent_errors: dict[int, list[int]] = field(init=False, default_factory=dict)
    # Clock errors of the first messages of each radar that is not decided yet.
    _first_ns: dict[int, list[int]] = field(init=False, default_factory=dict)
    _decided: set[int] = field(init=False, default_factory=set)

    def can_decide(
        self, radar: int, time_of_day: int, period: int, received_ns: int | None
    ) -> bool:
        """Return whether a radar's first messages suffice to decide about its clock error.

        A single message with a correct time suffices; otherwise the median of `FIRST` errors
        decides. Calls of `time_ns` should wait for this, so that all messages get the same shift.
        """
        if radar in self._decided:
            return True
        if received_ns is None:
            # If other messages have times of receipt, this one waits for the decision on them.
            return radar not in self._first_ns
        found = self._first_ns.setdefault(radar, [])
        if time_of_day == NONE or time_of_day >= period:
            return not found  # a message without a time is dated by its receipt
        found.append(received_ns - self._nearest(radar, time_of_day, period, received_ns))
        right = abs(found[-1]) <= self.max_offset_s * 1e9
        return right or len(found) >= FIRST

    def decide(self, radar: int, counts: Counter[str]) -> None:
        """Decide about a radar's clock error from the messages so far."""
        found = sorted(self._first_ns.pop(radar, ()))
        if radar in self._decided or not found:
            return
        self._decided.add(radar)
        shift_ns = found[len(found) // 2]
        if min(map(abs, found)) > self.max_offset_s * 1e9:
            self.shift_ns[radar] = shift_ns
            counts["clock_off"] += 1

    def time_ns(
        self,
        radar: int,
        time_of_day: int,
        period: int,
        received_ns: int | None,
        check_clock: bool,
        counts: Counter[str],
    ) -> int | None:
        """Return the time of a message, nanoseconds since the epoch; None if it fits no stamp.

        Parameters
        ----------
        time_of_day : int
            1/128 s modulo `period`; `NONE` if unknown.
        check_clock : bool
            Whether the message is evidence of the radar's clock error.
        counts : Counter
            Gains ``no_time`` for a message with no time or an impossible one, which gets the time
            of its receipt or of the radar's previous message; ``clock_off`` when a shift changes;
            and ``time_impossible`` for a time that fits no stamp.
        """
        if time_of_day == NONE or time_of_day >= period:
            counts["no_time"] += 1
            known = self._last_ns.get(radar, self._latest_ns)
            return received_ns if received_ns is not None else known or self.midnight_ns
        time_ns = self._nearest(radar, time_of_day, period, received_ns)
        if received_ns is not None and check_clock:
            self._update_shift(radar, received_ns - time_ns, counts)
        shift_ns = 0 if received_ns is None else self.shift_ns.get(radar, 0)
        if not fits_stamp(time_ns + shift_ns):
            counts["time_impossible"] += 1
            return None
        self._last_ns[radar] = self._latest_ns = time_ns
        return time_ns + shift_ns

    def is_plausible(self, time_ns: int, received_ns: int | None) -> bool:
        """Return whether a message's time is plausible, given its time of receipt."""
        return received_ns is None or abs(received_ns - time_ns) <= self.max_offset_s * 1e9

    def _nearest(self, radar: int, time_of_day: int, period: int, received_ns: int | None) -> int:
        """Return the possible time that is nearest to the receipt or to the previous message."""
        near_ns = received_ns
        if near_ns is None:
            near_ns = self._last_ns.get(radar, self._latest_ns)
        if near_ns is None:
            return self.midnight_ns + time_of_day * NS_PER_TICK
        day_ns = near_ns // NS_PER_DAY * NS_PER_DAY
        if period == DAY:
            own_ns = day_ns + time_of_day * NS_PER_TICK
            return own_ns + round((near_ns - own_ns) / NS_PER_DAY) * NS_PER_DAY
        times_ns = (
            _in_day(begin_ns, time_of_day, period, near_ns)
            for begin_ns in (day_ns, day_ns - NS_PER_DAY, day_ns + NS_PER_DAY)
        )
        return min(times_ns, key=lambda time_ns: abs(time_ns - near_ns))

    def _update_shift(self, radar: int, offset_ns: int, counts: Counter[str]) -> None:
        """Change the radar's shift if its times persistently differ from the receipts."""
        self.offset_s[radar] = offset_ns * 1e-9
        limit_ns = self.max_offset_s * 1e9
        if abs(offset_ns - self.shift_ns.get(radar, 0)) <= limit_ns:
            self._recent_errors.pop(radar, None)
            return
        errors = [*self._recent_errors.get(radar, []), offset_ns][-LEAST_OFF:]
        self._recent_errors[radar] = errors
        # A clock error is constant. Scattered errors do not come from a clock.
        if len(errors) < LEAST_OFF or max(errors) - min(errors) > limit_ns:
            return
        del self._recent_errors[radar]
        self.shift_ns[radar] = offset_ns if abs(offset_ns) > limit_ns else 0
        counts["clock_off"] += 1


def _in_day(begin_ns: int, time_of_day: int, period: int, near_ns: int) -> int:
    """Return the time of a day that is nearest to another time, given the time modulo a period.

    A truncated time also restarts at midnight, since its period does not divide the day; the last
    period of a day is therefore short.
    """
    own_ns, length_ns = time_of_day * NS_PER_TICK, period * NS_PER_TICK
    last = (NS_PER_DAY - 1 - own_ns) // length_ns
    turns = round((near_ns - begin_ns - own_ns) / length_ns)
    return begin_ns + own_ns + min(max(turns, 0), last) * length_ns
