"""Keeps the joint picture's number of each track, by stamp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .ownership import Track

# A track that has ended keeps its number for smoothed estimates for KEPT_S seconds. Numbers are
# forgotten after FORGOTTEN_S seconds.
KEPT_S, FORGOTTEN_S = 60.0, 600.0
# Largest number of tracks, the latest ones, whose numbers are kept. Without this bound a tracker
# that renumbers its tracks at every stamp would fill the memory.
MOST_TRACKS = 50_000


@dataclass
class _Spell:
    """An interval in which a track had one number."""

    first_ns: int
    last_ns: int
    number: int


@dataclass
class Numbers:
    """The number that each track had at each filtered stamp."""

    # Longest time after a stamp for which a track of this stamp may still receive its number,
    # nanoseconds.
    wait_ns: int
    _spells: dict[Track, list[_Spell]] = field(init=False, default_factory=dict)

    def add(self, stamp_ns: int, numbers: Mapping[Track, int]) -> None:
        """Add the numbers of a stamp; stamps must increase."""
        for track, number in numbers.items():
            spells = self._spells.setdefault(track, [])
            if spells and spells[-1].number == number:
                spells[-1].last_ns = stamp_ns
            else:
                spells.append(_Spell(stamp_ns, stamp_ns, number))
        oldest_ns = stamp_ns - round(FORGOTTEN_S * 1e9)
        kept = {
            track: [spell for spell in spells if spell.last_ns >= oldest_ns]
            for track, spells in self._spells.items()
        }
        kept = {track: spells for track, spells in kept.items() if spells}
        if len(kept) > MOST_TRACKS:
            latest = sorted(kept, key=lambda track: kept[track][-1].last_ns)[-MOST_TRACKS:]
            kept = {track: kept[track] for track in latest}
        self._spells = kept

    def at(self, stamp_ns: int) -> dict[Track, int]:
        """Return each track's number at a stamp, else its next number, else its last one."""
        found = {}
        oldest_ns = stamp_ns - round(KEPT_S * 1e9)
        for track, spells in self._spells.items():
            for spell in spells:
                if spell.first_ns <= stamp_ns + self.wait_ns and spell.last_ns >= oldest_ns:
                    found[track] = spell.number
                if spell.last_ns >= stamp_ns:
                    break
        return found
