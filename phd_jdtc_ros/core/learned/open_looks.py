"""Looks at targets that do not count yet: no later detection shows that the target was there.

A miss has two explanations: the sensor did not detect the target, or the target was no longer
there. Between two detections of a target only the first explanation is possible. Therefore a look,
detection or miss, counts when the target is detected again, by any sensor. A target's first
detection never counts, because there would be no target without it. Its last detection and later
misses do not count either: when a target disappears, or was false, its open looks disappear too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, ReadOnly, contains, contiguous, zeros
from ..compilation import Float1, Int1, compiled
from ..snapshot import MAX_INDEX, floats, integers
from .detection_factor import Counted

# Looks with a smaller open share are dropped.
LEAST_OPEN = 1e-3
# Largest number of expected detections of one look: a small learned factor can bring the
# configured probability above 1.
MOST_EXPECTED = 100.0


class Looks(NamedTuple):
    """Looks of one sensor at T targets in one report, arrays of shape (T,)."""

    label: IntArray  # Ascending
    cell: IntArray  # Number of the sensor's cell in which the target is, unique among sensors
    # Detections expected with the configured probability; the look does not count if 0.
    expected: FloatArray
    detected: FloatArray  # Probability that the target was detected, if it exists
    existence: FloatArray  # Existence probability after the report


@dataclass(frozen=True, eq=False)
class OpenLooks(ReadOnly):
    """Open looks, arrays of shape (E,)."""

    # Label of the target.
    label: Annotated[IntArray, integers("E", 0, MAX_INDEX)] = zeros(0, dtype=np.int64)
    # As in `Looks`.
    cell: Annotated[IntArray, integers("E", 0, below="K")] = zeros(0, dtype=np.int64)
    expected: Annotated[FloatArray, floats("E", 0.0, MOST_EXPECTED)] = zeros(0)
    detected: Annotated[FloatArray, floats("E", 0.0, 1.0)] = zeros(0)
    # Share of each look that is open.
    still: Annotated[FloatArray, floats("E", 0.0, 1.0)] = zeros(0)

    def __len__(self) -> int:
        return len(self.label)

    def take(self, rows: IntArray | BoolArray) -> OpenLooks:
        """Return these looks."""
        return OpenLooks(
            self.label[rows],
            self.cell[rows],
            self.expected[rows],
            self.detected[rows],
            self.still[rows],
        )

    def of(self, labels: IntArray) -> OpenLooks:
        """Return the looks at the targets of ascending labels."""
        return self.take(contains(labels, self.label))

    def after(self, looks: Looks, cells: int) -> tuple[OpenLooks, Counted]:
        """Return the open looks after a report, and those that count now.

        `cells` is the number of all sensors' cells, K.

        Notes
        -----
        If a target is detected with probability d, given that it exists, the share d of its open
        looks counts, times its existence probability. The share 1 - d stays open, and so does the
        report's own look at it.
        """
        label, cell, expected, detected, still, *counted = _after(
            *(LEAST_OPEN, cells, self.label, self.cell, self.expected, self.detected, self.still),
            *contiguous(*looks),
        )
        return OpenLooks(label, cell, expected, detected, still), Counted(*counted)


@compiled
def _after(
    least: float,
    cells: int,
    label: Int1,
    cell: Int1,
    expected: Float1,
    detected: Float1,
    still: Float1,
    own_label: Int1,
    own_cell: Int1,
    own_expected: Float1,
    own_detected: Float1,
    existence: Float1,
) -> tuple[
    IntArray, IntArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray
]:
    """Return the columns of `OpenLooks` and of `Counted` after a report.

    The last arguments, from `own_label` on, are the columns of the report's `Looks`.
    """
    size, targets, room = len(label), len(own_label), 0
    counts, most = np.zeros((3, cells)), size + targets
    labels, places = np.empty(most, np.int64), np.empty(most, np.int64)
    values = np.empty((3, most))
    place = np.searchsorted(own_label, label)
    for look in range(size):
        one, now = place[look], 0.0
        if one < targets and own_label[one] == label[look]:
            now = own_detected[one]
            counting = now * existence[one] * still[look]
            counts[0, cell[look]] += counting
            counts[1, cell[look]] += counting * expected[look]
            counts[2, cell[look]] += counting * detected[look]
        left = (1.0 - now) * still[look]
        if left > least:
            labels[room], places[room] = label[look], cell[look]
            values[0, room], values[1, room], values[2, room] = expected[look], detected[look], left
            room += 1
    for one in range(targets):
        if own_expected[one] > 0.0:
            labels[room], places[room] = own_label[one], own_cell[one]
            values[0, room], values[1, room], values[2, room] = (
                own_expected[one],
                own_detected[one],
                1.0,
            )
            room += 1
    return (
        labels[:room].copy(),
        places[:room].copy(),
        values[0, :room].copy(),
        values[1, :room].copy(),
        values[2, :room].copy(),
        counts[0],
        counts[1],
        counts[2],
    )
