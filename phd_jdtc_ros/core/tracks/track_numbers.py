"""Track numbers: small, in the order in which tracks are first reported.

A new track of an aircraft that had a number before, by its address, has that number again. Two
tracks of one aircraft both have the older number, and the better one is reported, or of two equally
good ones the one that was reported before. Two tracks that one radar detects apart, look after
look, are not of one aircraft: the address was assigned twice, or something reflects it. Each keeps
its own number.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import IntArray
from ..snapshot import MAX_INDEX, Snapshot, from_snapshot, integers, to_snapshot
from ..types import COASTING, CONFIRMED, TENTATIVE, UNKNOWN, Estimates
from .known_aircraft import MARGIN, KnownAircraft, Reach

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
# Rank of a track by its state. Of two tracks of one aircraft, the one of lower rank is reported.
PREFERENCE = {CONFIRMED: 0, COASTING: 1, TENTATIVE: 2}


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
        states = numbered.track_state.tolist()
        rank = np.array([PREFERENCE[state] for state in states], dtype=np.int64)
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
