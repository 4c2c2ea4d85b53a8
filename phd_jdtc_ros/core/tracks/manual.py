"""Manual work on tracks: what an operator has dropped, named and marked.

Each verb has its opposite: start and drop, drop and restore, a name and none, a mark and none. A
dropped track goes on unseen, so that its detections start no new one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..types import Estimates

START, DROP, RESTORE, NAME, MARK = VERBS = ("start", "drop", "restore", "name", "mark")
OWN, FRIEND, NONE = MARKS = ("own", "friend", "none")
# Largest numbers of tracks with an entry, and of letters of a name.
MOST, LONGEST = 1000, 40


class Command(NamedTuple):
    """What an operator wants."""

    verb: str  # One of `VERBS`
    track: int = 0  # Track number; 0 for a start
    text: str = ""  # The name, or one of `MARKS`
    # Of a start: x, y, metres, and velocity, metres per second, 0 if it is not known.
    motion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)


@dataclass
class Manual:
    """The operator's entries by track number, which no other track will have."""

    dropped: set[int] = field(default_factory=set)
    names: dict[int, str] = field(default_factory=dict)
    marks: dict[int, str] = field(default_factory=dict)

    def apply(self, command: Command, last: int) -> str:
        """Apply a command other than a start; return what was done in words.

        `last` is the latest track number. Raise `ValueError` for what cannot be done.
        """
        verb, track, text, _ = command
        if not 0 < track <= last:
            raise ValueError(f"track: {track} given, must be from 1 to {last}")
        if verb == RESTORE:
            if track not in self.dropped:
                raise ValueError(f"track: {track} given, must be a dropped one")
            self.dropped.remove(track)
            return f"track {track} restored"
        entries = {DROP: self.dropped, NAME: self.names, MARK: self.marks}[verb]
        if len(entries) >= MOST and track not in entries:
            raise ValueError(f"track: {track} given, but {MOST} tracks have such an entry already")
        if verb == DROP:
            self.dropped.add(track)
            return f"track {track} dropped"
        if verb == MARK and text not in MARKS:
            raise ValueError(f"mark: {text!r} given, must be one of {', '.join(MARKS)}")
        if verb == NAME and (len(text) > LONGEST or not text.isprintable()):
            raise ValueError(f"name: must be printable, with at most {LONGEST} letters")
        values, empty = (self.names, "") if verb == NAME else (self.marks, NONE)
        values.pop(track, None)
        if text != empty:
            values[track] = text
        return f"track {track}: {verb} {text or 'none'}"

    def select(self, estimates: tuple[Estimates, ...]) -> tuple[Estimates, ...]:
        """Return the estimates of each stamp without dropped tracks."""
        dropped = [*self.dropped]
        return tuple(found.select(~np.isin(found.track_id, dropped)) for found in estimates)

    @property
    def own(self) -> frozenset[int]:
        """The tracks that are own ship."""
        return frozenset(track for track, mark in self.marks.items() if mark == OWN)

    @property
    def friends(self) -> frozenset[int]:
        """The tracks that are friends, or own ship."""
        return frozenset(self.marks)
