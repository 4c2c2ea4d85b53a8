"""The aircraft that tracks have been of, by their addresses: so that one has one number.

Number and address of every track are kept with its last place, for a while after its end. A track
that begins with such an address, where that aircraft may be by then, is of the same aircraft. One
that is too far away is of another that was given the same address.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..models.tracker_model import TrackerModel
from ..snapshot import MOST_STAMP_NS, require_numbers, whole
from ..types import CONFIRMED, UNKNOWN, Estimates

# At most so many aircraft are kept, those seen last.
MOST_AIRCRAFT = 10_000
# Deviations of a new target's velocity that the fastest one has.
FASTEST_SIGMA = 3.0
# Metres between two places of one aircraft at one time: by what tracks and radars are off.
MARGIN = 1000.0
# Bounds of what a snapshot may hold, metres and metres per second.
MOST_PLACE = 1e9
MOST_ADDRESS = (1 << 24) - 1


@dataclass(frozen=True)
class Reach:
    """How far aircraft may go while they have no track, and for how long they are kept.

    Parameters
    ----------
    kept_s : float
        Seconds.
    speed : float
        Of the fastest, metres per second.
    """

    kept_s: float
    speed: float

    @staticmethod
    def of(model: TrackerModel) -> Reach | None:
        """Return the reach of a model's targets; None where no radar reports identities."""
        if model.attributes is None:
            return None
        speed = FASTEST_SIGMA * model.detection_births.velocity_std
        return Reach(model.attributes.code.kept_s, speed)


class LastSeen(NamedTuple):
    """Where the track of a number was when it was confirmed last.

    Parameters
    ----------
    address : int
    stamp_ns : int
    position : tuple of two floats
        In the world frame, metres.
    speed : float
        Metres per second.
    """

    address: int
    stamp_ns: int
    position: tuple[float, float]
    speed: float

    def may_be_at(self, position: Sequence[float], stamp_ns: int, reach: Reach) -> bool:
        """Return whether the aircraft may be at a place at a time, earlier or later."""
        since_s = abs(stamp_ns - self.stamp_ns) * 1e-9
        moved = float(np.hypot(position[0] - self.position[0], position[1] - self.position[1]))
        allowed = max(reach.speed, self.speed) * since_s + MARGIN
        return since_s <= reach.kept_s and moved <= allowed


@dataclass
class KnownAircraft:
    """The numbers of tracks whose addresses are known, and where they were last.

    Parameters
    ----------
    seen : dict of number to LastSeen
        Those that were seen last are last.
    """

    seen: dict[int, LastSeen] = field(default_factory=dict)
    _of_address: dict[int, set[int]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._of_address = {}
        for number, last in self.seen.items():
            self._of_address.setdefault(last.address, set()).add(number)

    def number_of(
        self, address: int, position: Sequence[float], stamp_ns: int, reach: Reach
    ) -> int | None:
        """Return the number of the aircraft with an address at a place; None if it is a new one.

        Of several it is that which was seen last, and then the oldest.
        """
        possible = [
            number
            for number in self._of_address.get(address, ())
            if self.seen[number].may_be_at(position, stamp_ns, reach)
        ]
        return min(possible, key=lambda n: (-self.seen[n].stamp_ns, n), default=None)

    def note(self, estimates: Estimates, reach: Reach) -> None:
        """Keep where the confirmed tracks of a set are, and forget who was not seen for long."""
        if estimates.attributes is None:
            return
        known = (estimates.attributes.address != UNKNOWN) & (estimates.track_id > 0)
        speed = np.hypot(*estimates.velocity.T)
        for row in np.flatnonzero(known & (estimates.track_state == CONFIRMED)).tolist():
            number, (x, y) = int(estimates.track_id[row]), estimates.position[row].tolist()
            before = self.seen.get(number)
            if before is not None and before.stamp_ns > estimates.stamp_ns:
                continue
            self._forget(number)
            address = int(estimates.attributes.address[row])
            self.seen[number] = LastSeen(address, estimates.stamp_ns, (x, y), float(speed[row]))
            self._of_address.setdefault(address, set()).add(number)
        oldest_ns = estimates.stamp_ns - reach.kept_s * 1e9
        while self.seen:
            number = next(iter(self.seen))
            if len(self.seen) <= MOST_AIRCRAFT and self.seen[number].stamp_ns >= oldest_ns:
                break
            self._forget(number)

    def _forget(self, number: int) -> None:
        last = self.seen.pop(number, None)
        if last is not None:
            same = self._of_address[last.address]
            same.discard(number)
            if not same:
                del self._of_address[last.address]

    def copy(self) -> KnownAircraft:
        """Return another of the same; what it notes, this one does not."""
        return KnownAircraft(dict(self.seen))

    @property
    def facts(self) -> list[list[Any]]:
        """What is kept, for a snapshot."""
        return [
            [number, last.address, last.stamp_ns, *last.position, last.speed]
            for number, last in self.seen.items()
        ]

    @staticmethod
    def of_facts(facts: Any, count: int) -> KnownAircraft:
        """Return what a snapshot has kept, of numbers up to `count`.

        Raises
        ------
        ValueError
            If it is nothing that the tracker could have stored.
        """
        seen: dict[int, LastSeen] = {}
        for number, address, stamp_ns, *rest in facts:
            state = np.array(rest)
            if state.shape != (3,):
                raise ValueError(f"tracks.aircraft: {state.shape} numbers given, expected 3")
            require_numbers("tracks.aircraft", state, -MOST_PLACE, MOST_PLACE)
            x, y, speed = state.tolist()
            seen[whole("tracks.aircraft", number, 1, count)] = LastSeen(
                whole("tracks.aircraft.address", address, 0, MOST_ADDRESS),
                whole("tracks.aircraft.stamp_ns", stamp_ns, 0, MOST_STAMP_NS),
                (x, y),
                speed,
            )
        if len(seen) > MOST_AIRCRAFT:
            raise ValueError(f"tracks.aircraft: {len(seen)} given, at most {MOST_AIRCRAFT}")
        return KnownAircraft(seen)
