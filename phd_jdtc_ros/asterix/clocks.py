"""Converts times of day to times since the epoch.

A message has no date. It gets the date that brings its time nearest to its receipt or, in a
recording without times of receipt, to the radar's previous message. Any number of midnights can
pass in a recording.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from phd_jdtc_ros.transport.network import fits_stamp

from .messages import DAY, NONE, TICKS_PER_S, Message

NS_PER_TICK = 10**9 // TICKS_PER_S
NS_PER_DAY = DAY * NS_PER_TICK


@dataclass
class StreamClock:
    """Values that the clocks of all radars of a stream share."""

    # Beginning of the day of the first message; used if its time of receipt is unknown.
    midnight_ns: int = 0
    # Largest tolerated clock error, seconds. A larger error is estimated and removed from the
    # radar's times.
    max_offset_s: float = 10.0
    latest_ns: int | None = field(init=False, default=None)  # Time of the latest message


@dataclass
class RadarClock:
    """Dates the messages of one radar.

    `counts` has ``no_time``, messages with no time or an impossible one, which get the time of
    their receipt or of the previous message; ``time_unknown``, those of them without either;
    ``clock_off``, how often the shift has changed; and ``time_impossible``, messages whose time
    fits no stamp.
    """

    # A clock error must show in this many consecutive messages, because a single one may be
    # delayed.
    MIN_ERRORS = 3
    # Number of first messages whose median gives the clock error.
    FIRST_MESSAGES = 15

    stream: StreamClock
    counts: Counter[str] = field(default_factory=Counter)
    offset_s: float = field(init=False, default=0.0)  # Latest receipt minus unshifted time
    # Correction that is added to the times of a wrong clock.
    shift_ns: int = field(init=False, default=0)
    _last_ns: int | None = field(init=False, default=None)
    # Latest consecutive errors beyond the present shift.
    _recent_errors: list[int] = field(init=False, default_factory=list)
    # Errors of the first messages; None before the first receipt and after the decision on them.
    _first_errors: list[int] | None = field(init=False, default=None)
    _decided: bool = field(init=False, default=False)

    def can_decide(self, message: Message, received_ns: int | None) -> bool:
        """Return whether the first messages suffice to decide about the clock error.

        A single message with a correct time suffices; otherwise the median of
        `FIRST_MESSAGES` errors decides. Calls of `time_ns` should wait for this, so that all
        messages get the same shift.
        """
        if self._decided:
            return True
        if received_ns is None:
            # If other messages have times of receipt, this one waits for the decision on them.
            return self._first_errors is None
        self._first_errors = self._first_errors or []
        if not _has_time(message):
            return not self._first_errors  # It is dated by its receipt
        error_ns = received_ns - self._nearest(message, received_ns)
        self._first_errors.append(error_ns)
        return abs(error_ns) <= self._limit_ns or len(self._first_errors) >= self.FIRST_MESSAGES

    def decide(self) -> None:
        """Decide about the clock error from the messages so far."""
        found, self._first_errors = sorted(self._first_errors or ()), None
        if self._decided or not found:
            return
        self._decided = True
        if min(map(abs, found)) > self._limit_ns:
            self.shift_ns = found[len(found) // 2]
            self.counts["clock_off"] += 1

    def time_ns(self, message: Message, received_ns: int | None, check_clock: bool) -> int | None:
        """Return the time of a message, nanoseconds since the epoch.

        It is None if it is unknown or fits no stamp.

        `check_clock` says whether the message is evidence of the radar's clock error.
        """
        if not _has_time(message):
            near_ns = self._near_ns(received_ns)
            self.counts["time_unknown" if near_ns is None else "no_time"] += 1
            return near_ns
        time_ns, shift_ns = self._nearest(message, received_ns), 0
        if received_ns is not None:
            if check_clock:
                self._update_shift(received_ns - time_ns)
            shift_ns = self.shift_ns
        if not fits_stamp(time_ns + shift_ns):
            self.counts["time_impossible"] += 1
            return None
        self._last_ns = self.stream.latest_ns = time_ns
        return time_ns + shift_ns

    @property
    def _limit_ns(self) -> float:
        return self.stream.max_offset_s * 1e9

    def _near_ns(self, received_ns: int | None) -> int | None:
        """Return the time of receipt, else of the previous message, None if there is neither."""
        if received_ns is not None:
            return received_ns
        return self.stream.latest_ns if self._last_ns is None else self._last_ns

    def _nearest(self, message: Message, received_ns: int | None) -> int:
        """Return the possible time that is nearest to the receipt or to the previous message."""
        near_ns, own_ns = self._near_ns(received_ns), message.time_of_day * NS_PER_TICK
        if near_ns is None:
            return self.stream.midnight_ns + own_ns
        day_ns = near_ns // NS_PER_DAY * NS_PER_DAY
        if message.period == DAY:
            own_ns += day_ns
            return own_ns + round((near_ns - own_ns) / NS_PER_DAY) * NS_PER_DAY
        times_ns = (
            _in_day(begin_ns, own_ns, message.period * NS_PER_TICK, near_ns)
            for begin_ns in (day_ns, day_ns - NS_PER_DAY, day_ns + NS_PER_DAY)
        )
        return min(times_ns, key=lambda time_ns: abs(time_ns - near_ns))

    def _update_shift(self, offset_ns: int) -> None:
        """Change the shift if the times persistently differ from the receipts."""
        self.offset_s = offset_ns * 1e-9
        if abs(offset_ns - self.shift_ns) <= self._limit_ns:
            self._recent_errors.clear()
            return
        self._recent_errors = errors = [*self._recent_errors, offset_ns][-self.MIN_ERRORS :]
        # A clock error is constant. Scattered errors do not come from a clock.
        if len(errors) < self.MIN_ERRORS or max(errors) - min(errors) > self._limit_ns:
            return
        self._recent_errors = []
        self.shift_ns = offset_ns if abs(offset_ns) > self._limit_ns else 0
        self.counts["clock_off"] += 1


def _has_time(message: Message) -> bool:
    return message.time_of_day != NONE and message.time_of_day < message.period


def _in_day(begin_ns: int, own_ns: int, period_ns: int, near_ns: int) -> int:
    """Return the time of a day that is nearest to another time, given the time modulo a period.

    The period does not divide the day, and a truncated time restarts at midnight: the last period
    of a day is shorter.
    """
    last = (NS_PER_DAY - 1 - own_ns) // period_ns
    revolutions = round((near_ns - begin_ns - own_ns) / period_ns)
    return begin_ns + own_ns + min(max(revolutions, 0), last) * period_ns
