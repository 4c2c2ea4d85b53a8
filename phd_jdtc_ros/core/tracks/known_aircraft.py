"""Aircraft known by their addresses: a new track of a known aircraft has the same number.

Number, address and last position of every track are stored, and kept for some time after its end. A
new track with the address, at a place that the aircraft can have reached, belongs to the same
aircraft. A track that is too far away belongs to another aircraft with the same address.
"""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..models.tracker_model import TrackerModel
from ..snapshot import (
    MAX_STAMP_NS,
    MAX_STATE,
    Snapshot,
    floats,
    from_snapshot,
    integers,
    to_snapshot,
)
from ..types import CONFIRMED, UNKNOWN, Estimates

# Largest number of aircraft that are stored; the most recently detected ones stay.
MAX_AIRCRAFT = 10_000
# Tolerance of the distance between two tracks of one aircraft, for errors of both, metres.
MARGIN = 1000.0
MAX_ADDRESS = (1 << 24) - 1


@dataclass(frozen=True)
class Reach:
    """Limits within which a new track may belong to an aircraft without a track."""

    kept_s: float  # Time for which aircraft are stored, seconds
    speed: float  # Speed of the fastest aircraft, metres per second
    # Time between two looks of the only radar, seconds; infinite with several radars, each of which
    # may have its own track of an aircraft because they disagree about its place.
    look_s: float = math.inf

    @staticmethod
    def of(model: TrackerModel) -> Reach | None:
        """Return the reach of a model's targets; None if no radar reports identities."""
        if model.attributes is None:
            return None
        # Largest speed, in standard deviations of a new target's velocity.
        speed = 3.0 * model.detection_births.velocity_std
        look_s = math.inf
        if len(model.radars) == 1:
            look_s = max(model.radars[0].rotation_s, model.modes.interval_s)
        return Reach(model.attributes.code.kept_s, speed, look_s)


class LastSeen(NamedTuple):
    """Last confirmed estimate of a track."""

    address: int
    stamp_ns: int
    position: tuple[float, float]  # In the world frame, metres
    speed: float  # Metres per second

    def may_be_at(self, position: Sequence[float], stamp_ns: int, reach: Reach) -> bool:
        """Return whether the aircraft can be at a position at an earlier or later time."""
        since_s = abs(stamp_ns - self.stamp_ns) * 1e-9
        distance = float(np.hypot(position[0] - self.position[0], position[1] - self.position[1]))
        reachable = max(reach.speed, self.speed) * since_s + MARGIN
        return since_s <= reach.kept_s and distance <= reachable


class Seen(NamedTuple):
    """Snapshot of track numbers and their `LastSeen`, as columns of R rows."""

    number: Annotated[IntArray, integers("R", 1)]
    address: Annotated[IntArray, integers("R", 0, MAX_ADDRESS)]
    stamp_ns: Annotated[IntArray, integers("R", 0, MAX_STAMP_NS)]
    position: Annotated[FloatArray, floats("RA", -MAX_STATE, MAX_STATE)]
    speed: Annotated[FloatArray, floats("R", -MAX_STATE, MAX_STATE)]


@dataclass
class KnownAircraft:
    """Numbers and last estimates of the tracks with known addresses."""

    # By number, in the order of the last confirmed estimates.
    seen: dict[int, LastSeen] = field(default_factory=dict)
    _of_address: dict[int, set[int]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._of_address = {}
        for number, last_seen in self.seen.items():
            self._of_address.setdefault(last_seen.address, set()).add(number)

    def number_of(
        self, address: int, position: Sequence[float], stamp_ns: int, reach: Reach
    ) -> int | None:
        """Return the number of the aircraft with an address at a place; None if it is a new one.

        Of several, the one detected last is returned; of these, the one with the smallest number.
        """
        possible = [
            number
            for number in self.seen_with(address)
            if self.seen[number].may_be_at(position, stamp_ns, reach)
        ]
        return min(possible, key=lambda n: (-self.seen[n].stamp_ns, n), default=None)

    def seen_with(self, address: int) -> Set[int]:
        """Return the numbers that were last reported with an address."""
        return self._of_address.get(address, set())

    def note(self, estimates: Estimates, reach: Reach) -> None:
        """Store the positions of confirmed tracks, and drop aircraft not seen for too long."""
        if estimates.attributes is None:
            return
        has_address = (estimates.attributes.address != UNKNOWN) & (estimates.track_id > 0)
        speed = np.hypot(*estimates.velocity.T)
        for row in np.flatnonzero(has_address & (estimates.track_state == CONFIRMED)).tolist():
            number, (x, y) = int(estimates.track_id[row]), estimates.position[row].tolist()
            last_seen = self.seen.get(number)
            if last_seen is not None and last_seen.stamp_ns > estimates.stamp_ns:
                continue
            self._forget(number)
            address = int(estimates.attributes.address[row])
            self.seen[number] = LastSeen(address, estimates.stamp_ns, (x, y), float(speed[row]))
            self._of_address.setdefault(address, set()).add(number)
        oldest_ns = estimates.stamp_ns - reach.kept_s * 1e9
        while self.seen:
            number = next(iter(self.seen))
            if len(self.seen) <= MAX_AIRCRAFT and self.seen[number].stamp_ns >= oldest_ns:
                break
            self._forget(number)

    def _forget(self, number: int) -> None:
        last = self.seen.pop(number, None)
        if last is not None:
            same = self._of_address[last.address]
            same.discard(number)
            if not same:
                del self._of_address[last.address]

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the aircraft in a snapshot."""
        address, stamp_ns, position, speed = (
            zip(*self.seen.values(), strict=True) if self.seen else ((), (), (), ())
        )
        table = Seen(
            np.array([*self.seen], dtype=np.int64),
            np.array(address, dtype=np.int64),
            np.array(stamp_ns, dtype=np.int64),
            np.array(position, dtype=np.float64).reshape(-1, 2),
            np.array(speed, dtype=np.float64),
        )
        to_snapshot(table, snapshot, "aircraft")

    @staticmethod
    def from_snapshot(snapshot: Snapshot, count: int) -> KnownAircraft:
        """Return the stored aircraft, with numbers up to `count`.

        Raise `ValueError` if the tracker cannot have stored these values.
        """
        table = from_snapshot(Seen, snapshot, "aircraft", {"A": 2})
        if table.number.max(initial=0) > count or len(table.number) > MAX_AIRCRAFT:
            raise ValueError(
                f"aircraft.number: {len(table.number)} aircraft with numbers up to "
                f"{table.number.max()}, expected at most {MAX_AIRCRAFT} with numbers up to {count}"
            )
        seen = {}
        for number, address, stamp_ns, (x, y), speed in zip(
            *(column.tolist() for column in table), strict=True
        ):
            seen[number] = LastSeen(address, stamp_ns, (x, y), speed)
        return KnownAircraft(seen)
