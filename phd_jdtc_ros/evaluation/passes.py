"""Passes over the truth, which repeats its stamps when a recording is replayed in a loop."""

from __future__ import annotations

from typing import TypeVar

from phd_jdtc_ros.core.types import SOURCES

# A repeated stamp of the truth begins a new pass if more than JUMP_SCANS known stamps are later;
# otherwise it is ignored as a duplicate. RESET_THRESHOLD_SCANS is the tracker's counterpart.
JUMP_SCANS = 3

Key = TypeVar("Key")
Value = TypeVar("Value")
# Source, filtered or smoothed, and stamp.
ScoreKey = tuple[str, int]


class Passes:
    """The stamps and scores of the present pass, and the scores due from the previous one.

    The newest `keep` stamps are stored; all of them if it is None.
    """

    def __init__(self, keep: int | None) -> None:
        self._keep = keep
        self._scored: dict[ScoreKey, None] = {}
        self._due: set[ScoreKey] = set()
        self.stamps: dict[int, None] = {}

    def add_truth(self, stamp_ns: int) -> bool:
        """Add a stamp of the truth; return whether it is new in its pass."""
        if stamp_ns in self.stamps:
            if sum(other > stamp_ns for other in self.stamps) <= JUMP_SCANS:
                return False
            self._begin()
        put(self.stamps, stamp_ns, None, self._keep)
        return True

    def take_due(self, key: ScoreKey) -> bool:
        """Return whether a score was due from the previous pass, and expect it no longer."""
        due = key in self._due
        self._due.discard(key)
        return due

    def is_scored(self, key: ScoreKey) -> bool:
        """Return whether a score is recorded in this pass."""
        return key in self._scored

    def record(self, key: ScoreKey) -> None:
        """Record a score."""
        put(self._scored, key, None, None if self._keep is None else len(SOURCES) * self._keep)

    def _begin(self) -> None:
        """Begin a pass; the last estimates of the previous one arrive after its end."""
        stamps = {*self.stamps, *(stamp for _, stamp in self._scored)}
        self._due = {(source, stamp) for source in SOURCES for stamp in stamps}
        self._due.difference_update(self._scored)
        self._scored.clear()
        self.stamps.clear()


def put(store: dict[Key, Value], key: Key, value: Value, most: int | None) -> None:
    """Store the newest entry, and remove the oldest ones beyond `most`."""
    store.pop(key, None)
    store[key] = value
    while most is not None and len(store) > most:
        del store[next(iter(store))]
