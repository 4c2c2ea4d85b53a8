"""Times of day to times since the epoch.

A message has no date. Its day is the one that brings it nearest to when it was received or, in a
recording that does not say that, to the radar's time before; so midnight is passed as often as
need be.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from .messages import DAY, NONE, TICKS_PER_S

NS_PER_TICK = 10**9 // TICKS_PER_S
NS_PER_DAY = DAY * NS_PER_TICK
# So many messages after each other must say that a clock is off, because a single one may be old.
LEAST_OFF = 3
# Of so many first ones by how much.
FIRST = 15
# Stamps say the seconds since 1970 in 31 bits. A day less: slices end later than their plots.
LAST_NS = (2**31 - 1) * 10**9 - NS_PER_DAY


def possible(time_ns: int) -> bool:
    """Return whether a time can be a stamp."""
    return 0 <= time_ns <= LAST_NS


@dataclass
class StreamClock:
    """The times of all radars of a stream.

    Parameters
    ----------
    midnight_ns : int
        Begin of the day of the first message where it is not known when that was received.
    max_offset_s : float
        A radar whose times differ by more from those of the receipts has a wrong clock. Its times
        are then shifted by the difference.

    Attributes
    ----------
    offset_s : dict of radar to float
        How much later each radar's last message was received than it says, before any shift.
    shift_ns : dict of radar to int
        What is added to the times of radars with wrong clocks.
    """

    midnight_ns: int = 0
    max_offset_s: float = 10.0
    offset_s: dict[int, float] = field(init=False, default_factory=dict)
    shift_ns: dict[int, int] = field(init=False, default_factory=dict)
    _last_ns: dict[int, int] = field(init=False, default_factory=dict)
    _latest_ns: int | None = field(init=False, default=None)
    # By how much the latest messages of a radar differ in a row from what its shift makes of them.
    _off: dict[int, list[int]] = field(init=False, default_factory=dict)
    _first_ns: dict[int, list[int]] = field(init=False, default_factory=dict)
    _settled: set[int] = field(init=False, default_factory=set)

    def settles(self, radar: int, time_of_day: int, period: int, received_ns: int | None) -> bool:
        """Return whether a radar's first messages tell by now how far its clock is off.

        One that is right says that it is not; otherwise the median of `FIRST` tells. Until then no
        message's `time_ns` should be asked for, so that all have the same shift.
        """
        if radar in self._settled:
            return True
        if received_ns is None:
            # Where some receipts are known those that come tell, and this message waits with them.
            return radar not in self._first_ns
        found = self._first_ns.setdefault(radar, [])
        if time_of_day == NONE or time_of_day >= period:
            return not found  # what has no time has that of its receipt
        found.append(received_ns - self._nearest(radar, time_of_day, period, received_ns))
        right = abs(found[-1]) <= self.max_offset_s * 1e9
        return right or len(found) >= FIRST

    def settle(self, radar: int, counts: Counter[str]) -> None:
        """Decide by the first messages so far how far a radar's clock is off."""
        found = sorted(self._first_ns.pop(radar, ()))
        if radar in self._settled or not found:
            return
        self._settled.add(radar)
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
        judged: bool,
        counts: Counter[str],
    ) -> int | None:
        """Return the time of a message, nanoseconds since the epoch; None if it cannot be true.

        Parameters
        ----------
        time_of_day : int
            1/128 s modulo `period`; `NONE` if it is not known.
        judged : bool
            Whether the message shows if the radar's clock is right.
        counts : Counter
            Gains ``no_time`` for a message without a time or with an impossible one, which counts
            as of its receipt or of the radar's message before; ``clock_off`` when a shift changes;
            and ``time_impossible`` for a time that no stamp can say.
        """
        if time_of_day == NONE or time_of_day >= period:
            counts["no_time"] += 1
            known = self._last_ns.get(radar, self._latest_ns)
            return received_ns if received_ns is not None else known or self.midnight_ns
        time_ns = self._nearest(radar, time_of_day, period, received_ns)
        if received_ns is not None and judged:
            self._judge(radar, received_ns - time_ns, counts)
        shift_ns = 0 if received_ns is None else self.shift_ns.get(radar, 0)
        if not possible(time_ns + shift_ns):
            counts["time_impossible"] += 1
            return None
        self._last_ns[radar] = self._latest_ns = time_ns
        return time_ns + shift_ns

    def believes(self, time_ns: int, received_ns: int | None) -> bool:
        """Return whether a message's time may be true, given when it was received."""
        return received_ns is None or abs(received_ns - time_ns) <= self.max_offset_s * 1e9

    def _nearest(self, radar: int, time_of_day: int, period: int, received_ns: int | None) -> int:
        """Return the time that is nearest to the best that is known of it."""
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

    def _judge(self, radar: int, offset_ns: int, counts: Counter[str]) -> None:
        """Shift the radar's times if they keep differing from those of the receipts."""
        self.offset_s[radar] = offset_ns * 1e-9
        limit_ns = self.max_offset_s * 1e9
        if abs(offset_ns - self.shift_ns.get(radar, 0)) <= limit_ns:
            self._off.pop(radar, None)
            return
        off = [*self._off.get(radar, []), offset_ns][-LEAST_OFF:]
        self._off[radar] = off
        # A clock that is off is so by the same each time; times that are anything are no clock's.
        if len(off) < LEAST_OFF or max(off) - min(off) > limit_ns:
            return
        del self._off[radar]
        self.shift_ns[radar] = offset_ns if abs(offset_ns) > limit_ns else 0
        counts["clock_off"] += 1


def _in_day(begin_ns: int, time_of_day: int, period: int, near_ns: int) -> int:
    """Return the time of a day that is nearest to another, given it modulo a period.

    Shorter periods do not divide the day, and begin again at midnight.
    """
    own_ns, length_ns = time_of_day * NS_PER_TICK, period * NS_PER_TICK
    last = (NS_PER_DAY - 1 - own_ns) // length_ns
    turns = round((near_ns - begin_ns - own_ns) / length_ns)
    return begin_ns + own_ns + min(max(turns, 0), last) * length_ns
