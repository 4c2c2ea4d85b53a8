"""First detections of targets, which count as false until later looks show the targets.

A target's own first detection hardly tells it from clutter. What is learned of clutter counts this
detection by the probability that it is false, nearly one. Where targets are as frequent as clutter,
as far from a radar of the sea, their first detections would hide the next targets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray, ReadOnly, contains, matches, zeros_field
from ...snapshot import MAX_INDEX, floats, integers
from ..factor import LEAST_EXISTENCE, Look

# First detections that count less are forgotten.
LEAST_COUNT = 1e-3
# Largest count accepted in a snapshot: probabilities, scaled to a whole revolution.
MAX_COUNT = 1e9


@dataclass(frozen=True, eq=False)
class FirstDetections(ReadOnly):
    """What the first detections of E targets count as false ones.

    Such a detection is false if its target never existed. A look that changes the existence
    probability from r to r' multiplies the probability of this by (1 - r') / (1 - r), because
    targets that never existed and those that have ended explain the look alike. The count changes
    by the same factor. That of a target which ends thus stays as small as it was.
    """

    # Label of each target, (E,).
    label: Annotated[IntArray, integers("E", 0, MAX_INDEX)] = zeros_field(0, dtype=np.int64)
    # Where in the learned law the detection counts, (E,).
    place: Annotated[FloatArray, floats("E", 0.0, MAX_COUNT)] = zeros_field(0)
    # How much it still counts there, (E,).
    count: Annotated[FloatArray, floats("E", 0.0, MAX_COUNT)] = zeros_field(0)

    def __len__(self) -> int:
        return len(self.label)

    def judged(self, look: Look) -> tuple[FirstDetections, FloatArray]:
        """Return the counts after a look, and their changes, (E,)."""
        row, target = matches(look.targets.label, self.label)
        if not len(row):
            return self, np.zeros(len(self))
        absent, still_absent = (
            np.maximum(1.0 - existence[target], LEAST_EXISTENCE)
            for existence in (look.targets.existence, look.association.existence)
        )
        count = self.count.copy()
        count[row] *= still_absent / absent
        return self.changed(count=count), count - self.count

    def with_born(self, look: Look, place: FloatArray, count: FloatArray) -> FirstDetections:
        """Return these and those of a look; `place` and `count` are of all its detections, (M,)."""
        every = FirstDetections(
            np.concatenate([self.label, look.born]),
            np.concatenate([self.place, place[look.born_at]]),
            np.concatenate([self.count, count[look.born_at]]),
        )
        return every._take(every.count > LEAST_COUNT)

    def fading(self, retention: float) -> FirstDetections:
        """Return them after the law has kept this share of all counts."""
        return self.changed(count=retention * self.count)

    def of(self, labels: IntArray) -> FirstDetections:
        """Return those of targets of ascending labels."""
        return self._take(contains(labels, self.label))

    def _take(self, rows: BoolArray) -> FirstDetections:
        return FirstDetections(self.label[rows], self.place[rows], self.count[rows])
