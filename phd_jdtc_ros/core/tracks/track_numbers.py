"""Track numbers: small, in the order in which tracks are first reported.

A new track of an aircraft that had a number before, by its address, has that number again. Two
tracks of one aircraft both have the older number, and the better one is reported, or of two equally
good ones the one that was reported before. Two tracks that one radar detects apart, look after
look, are not of one aircraft: the address was assigned twice, or something reflects it. Each keeps
its own number.

For this the number, address and last position of every track are stored, and kept for some time
after its end. A new track with the address, at a place that the aircraft can have reached, belongs
to the same aircraft. A track that is too far away belongs to another one with the same address.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..models.tracker_model import TrackerModel
from ..snapshot import (
    MAX_INDEX,
    MAX_STAMP_NS,
    MAX_STATE,
    Snapshot,
    floats,
    from_snapshot,
    integers,
    to_snapshot,
)
from ..types import COASTING, CONFIRMED, TENTATIVE, UNKNOWN, Estimates

# Largest number of aircraft that are stored; the most recently detected ones stay.
MAX_AIRCRAFT = 10_000
# Tolerance of the distance between two tracks of one aircraft, for errors of both, metres.
MARGIN = 1000.0


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
    address: Annotated[IntArray, integers("R", 0, (1 << 24) - 1)]
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


LABELS_PER_SCAN = 1 << 24
# Largest number of scans. Labels contain the scan index and must fit 64 bits; at one scan a second
# the limit is reached after 4000 years.
MAX_SCANS = 1 << 37


def first_predicted(scan_index: int) -> int:
    """Return the first label for birth terms and spawned targets of a scan's prediction."""
    return scan_index * LABELS_PER_SCAN


def first_detected(scan_index: int) -> int:
    """Return the first label for targets born at a scan's detections."""
    return scan_index * LABELS_PER_SCAN + LABELS_PER_SCAN // 2


def birth_scan(label: IntArray) -> IntArray:
    """Return the index of the scan in which each label was created."""
    return label // LABELS_PER_SCAN


# The numbers of ended targets are kept while there are fewer labels than this.
FEW_NUMBERS = 256
# Two tracks are apart if their distance is more than this many standard deviations of it, and two
# aircraft if they were in so many looks.
APART_SIGMA, APART_LOOKS = 5.0, 3


class Numbers(NamedTuple):
    """Snapshot of the last assigned number, and of the labels and numbers in use, each (T,)."""

    # Largest restored number: messages have 32 bits for a track number, and half of the range
    # remains for tracks after the restart.
    last: Annotated[int, integers("", 0, 1 << 31)]
    label: Annotated[IntArray, integers("T", 0, MAX_INDEX + 1)]
    number: Annotated[IntArray, integers("T", 1)]


class TrackNumbers:
    """Maps labels to track numbers, in the order in which tracks are first reported.

    `number` has the number of each label in use, and `count` is the number that was assigned last.
    The first number is 1.
    """

    def __init__(
        self,
        number: dict[int, int] | None = None,
        count: int = 0,
        aircraft: KnownAircraft | None = None,
    ) -> None:
        self._number = number or {}
        self.count = count
        self.aircraft = aircraft or KnownAircraft()
        # How many numbers remained when those of ended targets were last dropped.
        self._kept = 0
        # In how many looks two labels of one address were apart, and the stamp of the last one.
        self._apart: dict[tuple[int, int], tuple[int, int]] = {}
        self._reported: dict[int, int] = {}  # The label that was last reported with each number

    def assign(self, estimates: Estimates, reach: Reach | None = None) -> Estimates:
        """Return the estimates with distinct track numbers instead of labels; 0 stays 0.

        `reach` limits which aircraft without a track a new track may continue; it is None if no
        radar reports identities.
        """
        if reach is None or estimates.attributes is None:
            return self._with_numbers(estimates)
        label = estimates.track_id.tolist()
        for row in [
            row for row, track_id in enumerate(label) if track_id and track_id not in self._number
        ]:
            self._continue(estimates, row, reach)
        self._join(estimates, reach)
        self._separate(estimates, reach)
        numbered = self._with_numbers(estimates)
        best = self._best_rows(estimates.track_id, numbered)
        numbered = numbered.take(best)
        self._reported |= zip(
            numbered.track_id.tolist(), estimates.track_id[best].tolist(), strict=True
        )
        self.aircraft.note(numbered, reach)
        return numbered

    def _join(self, estimates: Estimates, reach: Reach) -> None:
        """Give tracks of one address that are near each other the oldest of their numbers.

        Numbers that were reported with this address before are of two aircraft. The younger of two
        tracks that are found to be of two aircraft loses the number of the older one.
        """
        if estimates.attributes is None:
            return
        address = np.where(estimates.track_id > 0, estimates.attributes.address, UNKNOWN)
        for first, second in _pairs_of_equal(address, UNKNOWN):
            labels = estimates.track_id[[first, second]].tolist()
            numbers = [self._number[label] for label in labels if label in self._number]
            if _distance(estimates, first, second) > MARGIN:
                continue
            if not numbers:
                self.count += 1
                numbers = [self.count]
            own = int(address[first])
            known = {n for n in numbers if n in self.aircraft.seen_with(own)}
            if self._are_two(estimates, (first, second), reach):
                if len(numbers) > len(set(numbers)):
                    del self._number[max(labels)]
            elif len(known) < 2:
                self._number.update(dict.fromkeys(labels, min(numbers)))

    def _are_two(self, estimates: Estimates, pair: tuple[int, int], reach: Reach) -> bool:
        """Return whether two tracks of one address were detected apart in enough looks."""
        first, second = sorted(estimates.track_id[[*pair]].tolist())
        looks, last_ns = self._apart.get((first, second), (0, 0))
        if (estimates.track_state[[*pair]] == CONFIRMED).all():
            variance = float(np.trace(estimates.position_covariance[[*pair]].sum(axis=0)))
            if _distance(estimates, *pair) <= APART_SIGMA * math.sqrt(variance):
                looks, last_ns = 0, estimates.stamp_ns
            elif estimates.stamp_ns >= last_ns + (1e9 * reach.look_s if looks else 0.0):
                looks, last_ns = looks + 1, estimates.stamp_ns
            self._apart[first, second] = looks, last_ns
        return looks >= APART_LOOKS

    def _continue(self, estimates: Estimates, row: int, reach: Reach) -> None:
        """Give a track the number that the aircraft with its address had, if it had one."""
        address = UNKNOWN
        if estimates.attributes is not None:
            address = int(estimates.attributes.address[row])
        if address == UNKNOWN:
            return
        position, stamp_ns = estimates.position[row].tolist(), estimates.stamp_ns
        former = self.aircraft.number_of(address, position, stamp_ns, reach)
        if former is not None:
            self._number[int(estimates.track_id[row])] = former

    def _separate(self, estimates: Estimates, reach: Reach) -> None:
        """Withdraw a shared number from one of two confirmed tracks.

        If they have different addresses, it is withdrawn from the one that has not the number's,
        which continues the aircraft of its own address. If they are too far apart to be one
        aircraft, it is withdrawn from the younger one.
        """
        confirmed = estimates.track_state == CONFIRMED
        labels = estimates.track_id.tolist()
        number = np.where(confirmed, [self._number.get(label, 0) for label in labels], 0)
        for pair in _pairs_of_equal(number, 0):
            younger = max(pair, key=labels.__getitem__)
            wrong = self._of_another_aircraft(estimates, pair)
            if wrong is not None:
                self._number.pop(labels[wrong], None)
                self._continue(estimates, wrong, reach)
            elif _distance(estimates, *pair) > MARGIN:
                self._number.pop(labels[younger], None)

    def _of_another_aircraft(self, estimates: Estimates, pair: tuple[int, int]) -> int | None:
        """Return which of two tracks with one number has not its aircraft's address; or None."""
        if estimates.attributes is None:
            return None
        address = estimates.attributes.address[[*pair]].tolist()
        last_seen = self.aircraft.seen.get(self._number.get(int(estimates.track_id[pair[0]]), 0))
        if last_seen is None or UNKNOWN in address or last_seen.address not in address:
            return None
        others = [row for row, own in zip(pair, address, strict=True) if own != last_seen.address]
        return others[0] if others else None

    def _with_numbers(self, estimates: Estimates) -> Estimates:
        """Return the estimates with the numbers of their labels; new labels get the next ones."""
        number_of, label = self._number, estimates.track_id.tolist()
        for track_id in label:
            if track_id and track_id not in number_of:
                self.count += 1
                number_of[track_id] = self.count
        numbers = [number_of[track_id] if track_id else 0 for track_id in label]
        return estimates.changed(track_id=np.array(numbers, dtype=np.int64))

    def _best_rows(self, label: IntArray, numbered: Estimates) -> IntArray:
        """Return the rows of the best estimate of each number, and all without a number.

        `label` has the labels of the tracks that are numbered.
        """
        number = numbered.track_id
        # Of two tracks of one aircraft, the one of lower rank by its state is reported.
        ranks = {CONFIRMED: 0, COASTING: 1, TENTATIVE: 2}
        rank = np.array([ranks[state] for state in numbered.track_state.tolist()], dtype=np.int64)
        reported = [self._reported.get(each, 0) for each in number.tolist()]
        order = np.lexsort((-numbered.weight, label != reported, rank, number))
        is_best = np.append(True, np.diff(number[order]) > 0)[: len(order)] | (number[order] == 0)
        return np.sort(order[is_best])

    @property
    def in_use(self) -> dict[int, int]:
        """The number of each label; a copy."""
        return dict(self._number)

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the numbers in a snapshot."""
        label, number = (
            np.array([*values], dtype=np.int64) for values in (self._number, self._number.values())
        )
        to_snapshot(Numbers(self.count, label, number), snapshot, "numbers")
        self.aircraft.to_snapshot(snapshot)

    @staticmethod
    def from_snapshot(snapshot: Snapshot) -> TrackNumbers:
        """Return the stored numbers; raises ValueError if the tracker cannot have stored them."""
        stored = from_snapshot(Numbers, snapshot, "numbers", {})
        count, number = stored.last, stored.number
        if number.max(initial=0) > count:
            raise ValueError(f"numbers.number: {number.max()} given, must be at most {count}")
        pairs = dict(zip(stored.label.tolist(), number.tolist(), strict=True))
        return TrackNumbers(pairs, count, KnownAircraft.from_snapshot(snapshot, count))

    def forget_all_but(self, labels: Iterable[IntArray]) -> None:
        """Drop the numbers of targets that can no longer be reported.

        They are dropped only when the numbers have doubled since the last time, because a number
        without a target does no harm.
        """
        if len(self._number) > 2 * self._kept + FEW_NUMBERS:
            alive = set((np.concatenate([*labels]) + 1).tolist())
            self._number = {label: n for label, n in self._number.items() if label in alive}
            self._reported = {n: label for n, label in self._reported.items() if label in alive}
            self._apart = {pair: n for pair, n in self._apart.items() if alive.issuperset(pair)}
            self._kept = len(self._number)


class NoNumbers(TrackNumbers):
    """Keeps labels as track numbers, while scans are reprocessed."""

    def assign(self, estimates: Estimates, reach: Reach | None = None) -> Estimates:
        """Return the estimates unchanged."""
        return estimates

    def forget_all_but(self, labels: Iterable[IntArray]) -> None:
        """Keep all numbers: there are none to drop."""


def _pairs_of_equal(value: IntArray, none: int) -> Iterator[tuple[int, int]]:
    """Yield the pairs of rows with the same value, except for the value `none`."""
    distinct, count = np.unique(value[value != none], return_counts=True)
    for shared in distinct[count > 1]:
        yield from itertools.combinations(np.flatnonzero(value == shared).tolist(), 2)


def _distance(estimates: Estimates, first: int, second: int) -> float:
    """Return the distance of two estimates, metres."""
    return float(np.hypot(*(estimates.position[first] - estimates.position[second])))
