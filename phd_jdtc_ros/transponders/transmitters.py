"""What is known of each transmitter, and the rules for what is used of it.

Each rule answers a fault that receivers meet:

- one of 255 damaged sentences has a right checksum: a name, a type and dimensions count when they
  are heard twice, and the first message of an address that differs by one bit from that of a
  well-heard aircraft is left out;
- clocks stand, have other seconds than UTC, or none: a time counts if it is near the receipt, which
  is used otherwise;
- messages come again from other receivers, and without end from forgers.
"""

from __future__ import annotations

import math
from collections import Counter, OrderedDict, deque
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeVar

from phd_jdtc_ros.transport.network import fits_stamp

from .messages import ICAO, MMSI, NONE, Heard

T = TypeVar("T")
NS = 10**9
# Largest number of transmitters that are remembered; the one heard longest ago is forgotten first.
MOST = 10_000
# Largest number of reports of one address in a second.
MOST_IN_A_SECOND = 10
# An aircraft is well heard after this many messages, and until this time after the last.
WELL_HEARD, WELL_HEARD_NS = 20, 60 * NS
# The same position with the same time within this time is the same message, by another receiver;
# without a time, within the shorter one. What moves faster than `MOVING`, m/s, is never at a place
# again, so that its message may come from a slow network, within `LATE_NS`.
AGAIN_NS, AGAIN_UNTIMED_NS, LATE_NS, MOVING = 2 * NS, 3 * NS // 10, 10 * NS, 0.5
# Largest number of a ship, and the numbers of no aircraft.
LARGEST_MMSI, LARGEST_ICAO = 999_999_999, 2**24 - 1


class Twice(Generic[T]):
    """A value that counts once it has been heard twice."""

    def __init__(self) -> None:
        self.known: T | None = None
        self._candidate: T | None = None

    def hear(self, value: T) -> None:
        """Take a value; another one must be heard twice too."""
        if value != self.known and value == self._candidate:
            self.known = value
        self._candidate = value


class Dated(NamedTuple):
    """What was heard of a transmitter, with the time of its position since the epoch."""

    time_ns: int
    heard: Heard


@dataclass(slots=True)
class Transmitter:
    """What was heard of an address."""

    heard: int = 0  # Number of messages
    now_ns: int = 0  # When the last one came
    usual_ns: int | None = None  # When the last position came that was not a coarse one
    name: Twice[str] = field(default_factory=Twice)
    type: Twice[int] = field(default_factory=Twice)
    hull: Twice[tuple[int, int, int, int]] = field(default_factory=Twice)
    motion: Heard | None = None  # The last velocity without a position
    motion_ns: int = 0
    last: Heard | None = None  # The last position, and when it came
    last_ns: int = 0
    # When the latest positions came, with each one's latitude, longitude and time.
    recent: deque[tuple[int, tuple[float, float, int]]] = field(
        default_factory=lambda: deque(maxlen=MOST_IN_A_SECOND)
    )


class Transmitters:
    """Applies the rules to messages and dates them; `counts` gains what is left out, by reason.

    Left out are ``no_address``, ``own_ship``, ``one_bit``, ``no_position``, ``coarse``,
    ``too_many``, ``repeated`` and ``time_impossible``. Used with the time of their receipt are
    ``no_time``, ``time_off`` and ``time_stands``. ``names`` are messages without a position that
    were used.

    Without times of receipt the times of a recording follow each other from `start_ns` on.
    """

    # A ship that has sent usual positions within this time needs no coarse ones.
    USUAL_NS = 600 * NS
    # Two base stations' times this close to each other are right.
    CLOCKS_AGREE_NS = 600 * NS

    def __init__(self, counts: Counter[str], max_offset_ns: int, start_ns: int = 0) -> None:
        self.counts = counts
        self.known: OrderedDict[tuple[int, int], Transmitter] = OrderedDict()
        self.latest_ns = start_ns  # The latest time of a recording without receipts
        self._max_offset_ns = max_offset_ns
        self._own: set[int] = set()
        self._clock_ns = NONE

    def take(self, heard: Heard, received_ns: int | None) -> Dated | None:
        """Take a message, and return its position if it has one that is used."""
        if heard.clock:
            self._set_clock(heard.own_ns, received_ns)
            return None
        if not self._has_address(heard):
            self.counts["no_address"] += 1
            return None
        if heard.own_ship and len(self._own) < MOST:
            self._own.add(heard.address)
        if heard.space == MMSI and heard.address in self._own:
            self.counts["own_ship"] += 1
            return None
        now_ns = self.latest_ns if received_ns is None else received_ns
        one = self._of(heard, now_ns)
        if one is None:
            self.counts["one_bit"] += 1
            return None
        self._learn(one, heard, now_ns)
        if not heard.has_position:
            self.counts["names"] += 1
            return None
        return self._located(one, heard, received_ns)

    def _date(self, one: Transmitter, heard: Heard, received_ns: int | None) -> int | None:
        """Return the time of a position: its own one, or that of its receipt.

        It is None if it fits no stamp.
        """
        near_ns = received_ns
        if near_ns is None:
            # A time without a date is near the one before it; a whole one is as it is.
            near_ns = self.latest_ns if heard.own_ns < heard.period_ns else heard.own_ns
        if heard.own_ns == NONE:
            if heard.period_ns:  # Frames of Mode S never have one
                self.counts["no_time"] += 1
            return near_ns
        if received_ns is not None and self._stands(one, heard, received_ns):
            self.counts["time_stands"] += 1
            return received_ns
        found_ns = heard.own_ns + _multiple(near_ns - heard.own_ns, heard.period_ns)
        # A recording that begins in 1970 has nothing before it.
        found_ns += heard.period_ns if found_ns < 0 else 0
        if not fits_stamp(found_ns):
            self.counts["time_impossible"] += 1
            return None
        if received_ns is None:
            self.latest_ns = max(self.latest_ns, found_ns)
        elif abs(found_ns - received_ns) > self._max_offset_ns:
            self.counts["time_off"] += 1
            return received_ns
        return found_ns

    def _has_address(self, heard: Heard) -> bool:
        if heard.space == MMSI:
            return 0 < heard.address <= LARGEST_MMSI
        # Track numbers, and positions without any number, are as they are.
        return heard.space != ICAO or 0 < heard.address < LARGEST_ICAO

    def _of(self, heard: Heard, now_ns: int) -> Transmitter | None:
        """Return the transmitter of a message, None if its address is probably a damaged one."""
        key = heard.space, heard.address
        one = self.known.pop(key, None)
        damaged = one is None and heard.space == ICAO and self._has_neighbour(heard.address, now_ns)
        self.known[key] = one = one or Transmitter()
        one.heard, one.now_ns = one.heard + 1, now_ns
        if len(self.known) > MOST:
            self.known.popitem(last=False)
        return None if damaged else one

    def _has_neighbour(self, address: int, now_ns: int) -> bool:
        for bit in range(24):
            other = self.known.get((ICAO, address ^ 1 << bit))
            if other and other.heard >= WELL_HEARD and now_ns - other.now_ns <= WELL_HEARD_NS:
                return True
        return False

    @staticmethod
    def _learn(one: Transmitter, heard: Heard, now_ns: int) -> None:
        if heard.name:
            one.name.hear(heard.name)
        if heard.type:
            one.type.hear(heard.type)
        if heard.hull:
            one.hull.hear(heard.hull)
        if not heard.has_position and not (math.isnan(heard.speed) and math.isnan(heard.height)):
            one.motion, one.motion_ns = heard, now_ns

    def _located(self, one: Transmitter, heard: Heard, received_ns: int | None) -> Dated | None:
        if not (abs(heard.latitude) <= 90.0 and abs(heard.longitude) <= 180.0):
            self.counts["no_position"] += 1
            return None
        if heard.long_range:
            if one.usual_ns is not None and one.now_ns - one.usual_ns <= self.USUAL_NS:
                self.counts["coarse"] += 1
                return None
        else:
            one.usual_ns = one.now_ns
        if self._is_again(one, heard):
            self.counts["repeated"] += 1
            return None
        time_ns = self._date(one, heard, received_ns)
        if time_ns is None:
            return None
        came_ns = self.latest_ns if received_ns is None else received_ns
        identified = heard.address != NONE
        recent = one.recent
        if identified and len(recent) == MOST_IN_A_SECOND and 0 <= came_ns - recent[0][0] < NS:
            self.counts["too_many"] += 1
            return None
        recent.append((came_ns, _place(heard)))
        one.last, one.last_ns = heard, one.now_ns
        return Dated(time_ns, _complete(one, heard))

    @staticmethod
    def _is_again(one: Transmitter, heard: Heard) -> bool:
        if heard.address == NONE:
            return False
        within_ns = AGAIN_UNTIMED_NS
        if heard.own_ns != NONE:
            within_ns = LATE_NS if heard.speed > MOVING else AGAIN_NS
        place = _place(heard)
        return any(
            each == place and 0 <= one.now_ns - came_ns < within_ns for came_ns, each in one.recent
        )

    @staticmethod
    def _stands(one: Transmitter, heard: Heard, received_ns: int) -> bool:
        # An own time that is the same after this time stands.
        stands_ns = 3 * NS // 2
        if one.last is None or one.last.own_ns != heard.own_ns:
            return False
        passed_ns = received_ns - one.last_ns
        return abs(passed_ns - _multiple(passed_ns, heard.period_ns)) > stands_ns

    def _set_clock(self, own_ns: int, received_ns: int | None) -> None:
        """Take a base station's time, which dates a recording without times of receipt."""
        if received_ns is None and own_ns != NONE:
            if self._clock_ns != NONE and abs(own_ns - self._clock_ns) < self.CLOCKS_AGREE_NS:
                self.latest_ns = own_ns
            self._clock_ns = own_ns


def _place(heard: Heard) -> tuple[float, float, int]:
    """Return what two messages of one position have in common."""
    return heard.latitude, heard.longitude, heard.own_ns


def _multiple(passed_ns: int, period_ns: int) -> int:
    """Return the multiple of a period that is nearest to a time, 0 without a period."""
    return (2 * passed_ns + period_ns) // (2 * period_ns) * period_ns if period_ns else 0


def _complete(one: Transmitter, heard: Heard) -> Heard:
    """Return a position with what other messages of its transmitter have said."""
    found = heard._replace(name=one.name.known or "", type=one.type.known or 0, hull=one.hull.known)
    motion = one.motion
    # Velocities and heights come in messages of their own, and count for this time.
    motion_ns = 5 * NS
    if motion is None or one.now_ns - one.motion_ns > motion_ns:
        return found
    if math.isnan(found.speed):
        found = found._replace(speed=motion.speed, course=motion.course)
    return found._replace(height=motion.height) if math.isnan(found.height) else found
