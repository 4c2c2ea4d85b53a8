# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""One picture of several trackers' filtered and smoothed estimates, as they come.

Live and offline alike: estimates go in one by one, and come out joined, stamp by stamp. Filtered
ones get their numbers by `Handover`. Smoothed ones get the numbers of the same tracks at their
stamp, or those that the tracks have a little later: the smoother knows a target before the filter
is sure of it. So they wait until the filtered picture is ahead of them by that much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from .gathering import Gathered, Gathering, Refused
from .handover import Handover, Track
from .region import Region
from .types import FILTERED, SMOOTHED, SOURCES, Estimates

# For so long a track that the filter has no more keeps its number for smoothed estimates, and for
# so long the filtered picture's numbers are kept at most, seconds.
KEPT_S, FORGOTTEN_S = 60.0, 600.0

# Joint estimates, and whether they are filtered or smoothed.
Joint = tuple[str, Estimates]


@dataclass
class _Spell:
    """A time in which a track had one number."""

    first_ns: int
    last_ns: int
    number: int


@dataclass
class Numbers:
    """The number that each track had at each filtered stamp.

    Parameters
    ----------
    wait_ns : int
        How much later than a stamp its tracks may have got their numbers.
    """

    wait_ns: int
    _spells: dict[Track, list[_Spell]] = field(init=False, default_factory=dict)

    def add(self, stamp_ns: int, numbers: Mapping[Track, int]) -> None:
        """Take in the numbers of a stamp; stamps must increase."""
        for track, number in numbers.items():
            spells = self._spells.setdefault(track, [])
            if spells and spells[-1].number == number:
                spells[-1].last_ns = stamp_ns
            else:
                spells.append(_Spell(stamp_ns, stamp_ns, number))
        oldest_ns = stamp_ns - round(FORGOTTEN_S * 1e9)
        self._spells = {
            track: spells
            for track, spells in self._spells.items()
            if spells[-1].last_ns >= oldest_ns
        }

    def at(self, stamp_ns: int) -> dict[Track, int]:
        """Return each track's number at a stamp, or else its next one, or else its last one."""
        found = {}
        oldest_ns = stamp_ns - round(KEPT_S * 1e9)
        for track, spells in self._spells.items():
            for spell in spells:
                if spell.first_ns <= stamp_ns + self.wait_ns and spell.last_ns >= oldest_ns:
                    found[track] = spell.number
                if spell.last_ns >= stamp_ns:
                    break
        return found

    def clear(self) -> None:
        """Forget all."""
        self._spells = {}


class JointPicture:
    """Joins the estimates of trackers that part an area.

    Parameters
    ----------
    regions : sequence of Region
        One per tracker.
    hysteresis : float
        See `Handover`.
    wait_s : float
        By how much the filtered picture is ahead when smoothed estimates get their numbers,
        seconds.
    longest_delay_s : float
        See `Gathering`.
    """

    def __init__(
        self, regions: Sequence[Region], hysteresis: float, wait_s: float, longest_delay_s: float
    ) -> None:
        self._handover = Handover(regions, hysteresis)
        self._gathered = {source: Gathering(len(regions), longest_delay_s) for source in SOURCES}
        self._numbers = Numbers(round(wait_s * 1e9))
        self._smoothed: list[Gathered] = []
        self._reached_ns: int | None = None

    @property
    def silent(self) -> frozenset[int]:
        """The trackers without which the filtered picture goes on, by their index."""
        return self._gathered[FILTERED].silent

    @property
    def handed_over(self) -> int:
        """How often a target has changed over from one tracker to another."""
        return self._handover.handed_over

    def behind_s(self, tracker: int) -> float:
        """Return how much older a tracker's filtered estimates are than the newest, seconds."""
        return self._gathered[FILTERED].behind_s(tracker)

    def jumps_back(self, tracker: int, source: str, stamp_ns: int) -> bool:
        """Return whether `add` begins a new run, in which stamps are those of another time."""
        return self._gathered[source].jumps_back(tracker, stamp_ns)

    def add(self, tracker: int, source: str, found: Estimates) -> list[Joint] | Refused:
        """Take in the filtered or smoothed estimates of a tracker.

        Parameters
        ----------
        tracker : int
            Its index.
        source : str
            ``filtered`` or ``smoothed``.
        found : Estimates

        Returns
        -------
        list of (source, Estimates)
            What is complete by this, in the order of time for each source.
        Refused
            If they come too late or for the second time.
        """
        done = []
        if self.jumps_back(tracker, source, found.stamp_ns):
            done = self.close_all() if source == FILTERED else self._close_smoothed()
        closed = self._gathered[source].add(tracker, found)
        if isinstance(closed, Refused):
            return closed
        if source == SMOOTHED:
            self._smoothed += closed
            return done + self._numbered()
        for gathered in closed:
            done.append((FILTERED, self._filtered(gathered)))
            done += self._numbered()
        return done

    def close_all(self) -> list[Joint]:
        """Return all that waits, and begin a new run; numbers go on and are not used again."""
        done = [
            (FILTERED, self._filtered(each)) for each in self._gathered[FILTERED].close_all()
        ] + self._close_smoothed()
        self._handover.forget()
        self._numbers.clear()
        self._reached_ns = None
        return done

    def _close_smoothed(self) -> list[Joint]:
        self._smoothed += self._gathered[SMOOTHED].close_all()
        waiting, self._smoothed = self._smoothed, []
        return [(SMOOTHED, self._numbered_one(each)) for each in waiting]

    def _filtered(self, gathered: Gathered) -> Estimates:
        joint = self._handover.add(gathered)
        self._numbers.add(joint.stamp_ns, self._handover.numbers)
        self._reached_ns = joint.stamp_ns
        return joint

    def _numbered(self) -> list[Joint]:
        """Return the smoothed estimates that the filtered picture is ahead of by enough."""
        done = []
        while self._smoothed and self._reached_ns is not None:
            stamp_ns = next(iter(self._smoothed[0].values())).stamp_ns
            if stamp_ns + self._numbers.wait_ns > self._reached_ns:
                break
            done.append((SMOOTHED, self._numbered_one(self._smoothed.pop(0))))
        return done

    def _numbered_one(self, gathered: Gathered) -> Estimates:
        stamp_ns = next(iter(gathered.values())).stamp_ns
        return self._handover.numbered(gathered, self._numbers.at(stamp_ns))
