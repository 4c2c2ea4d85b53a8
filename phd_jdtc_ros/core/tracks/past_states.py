"""States of filtered tracks, for the smoothed estimates of the same stamps.

The smoother reports a track as the filter did at the stamp, and only if the filter reported it then
or later. The states of a stamp are needed until it has been smoothed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import IntArray
from ..snapshot import MAX_STAMP_NS, integers
from ..types import COASTING, CONFIRMED, TENTATIVE, Estimates


class NotedStates(NamedTuple):
    """Snapshot of `PastStates`; all columns (T,)."""

    stamp_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]
    label: Annotated[IntArray, integers("T", 0)]
    state: Annotated[IntArray, integers("T", TENTATIVE, COASTING)]


@dataclass(frozen=True)
class PastStates:
    """States of filtered tracks whose stamps may still be smoothed."""

    # State by stamp and then label; the stamps ascend.
    at: Mapping[int, Mapping[int, int]] = field(default_factory=dict)
    # Latest stamp at which each label had a state.
    latest_ns: Mapping[int, int] = field(default_factory=dict)

    def labels_since(self, stamp_ns: int) -> IntArray:
        """Return the labels that have a state at a stamp from this one on, ascending."""
        labels = [label for label, latest_ns in self.latest_ns.items() if latest_ns >= stamp_ns]
        return np.array(sorted(labels), dtype=np.int64)

    def then(self, published: Estimates) -> PastStates:
        """Return these states, and those of estimates of a later stamp."""
        stamp_ns, label = published.stamp_ns, published.track_id.tolist()
        states = dict(zip(label, published.track_state.tolist(), strict=True))
        latest_ns = {**self.latest_ns, **dict.fromkeys(label, stamp_ns)}
        return PastStates({**self.at, stamp_ns: states}, latest_ns)

    def since(self, stamp_ns: int) -> PastStates:
        """Return the states from a stamp on, nanoseconds, without tracks that ended before."""
        return PastStates(
            {stamp: states for stamp, states in self.at.items() if stamp >= stamp_ns},
            {label: stamp for label, stamp in self.latest_ns.items() if stamp >= stamp_ns},
        )

    def states(self, estimates: Estimates) -> IntArray:
        """Return the states of tracks at the stamp of their estimates; without one, tentative.

        Estimates without labels are confirmed.
        """
        label, noted = estimates.track_id.tolist(), self.at.get(estimates.stamp_ns, {})
        state = {**dict.fromkeys(label, TENTATIVE), 0: CONFIRMED, **noted}
        return np.array([state[track_id] for track_id in label], dtype=np.int64)

    @property
    def columns(self) -> NotedStates:
        """The states as columns of a snapshot, a row for each track and stamp."""
        rows = [
            (stamp_ns, *pair) for stamp_ns, states in self.at.items() for pair in states.items()
        ]
        return NotedStates(*np.array(rows, dtype=np.int64).reshape(-1, 3).T)

    @staticmethod
    def of(columns: NotedStates) -> PastStates:
        """Return the states that `columns` has stored."""
        at: dict[int, dict[int, int]] = {}
        latest_ns: dict[int, int] = {}
        for stamp_ns, label, state in zip(*(column.tolist() for column in columns), strict=True):
            at.setdefault(stamp_ns, {})[label] = state
            latest_ns[label] = max(stamp_ns, latest_ns.get(label, 0))
        return PastStates(at, latest_ns)
