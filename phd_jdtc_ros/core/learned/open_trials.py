"""Trials of detection that do not count yet: no later detection shows that the target was there.

A miss has two explanations: the sensor did not detect the target, or the target was no longer
there. Between two detections of a target only the first explanation is possible. Therefore a trial,
a look with a detection or a miss, counts when the target is detected again, by any sensor. A
target's first detection never counts, because there would be no target without it. Its last
detection and later misses do not count either: when a target disappears, or was false, its open
trials disappear too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, ReadOnly, contains, contiguous, zeros_field
from ..bisection import count_below
from ..compilation import Float1, Int1, compiled
from ..snapshot import MAX_INDEX, floats, integers

# Trials with a smaller open share are dropped.
LEAST_OPEN = 1e-3
# Largest number of expected detections of one trial: a small learned factor can bring the
# configured probability above 1.
MOST_EXPECTED = 100.0


class ReportTrials(NamedTuple):
    """Trials of one sensor for T targets in one report, arrays of shape (T,)."""

    label: IntArray  # Ascending
    cell: IntArray  # Number of the sensor's cell in which the target is, unique among sensors
    # Detections expected with the configured probability; the trial does not count if 0.
    expected: FloatArray
    detected: FloatArray  # Probability that the target was detected, if it exists
    existence: FloatArray  # Existence probability after the report


@dataclass(frozen=True, eq=False)
class OpenTrials(ReadOnly):
    """Open trials, arrays of shape (E,)."""

    # Label of the target.
    label: Annotated[IntArray, integers("E", 0, MAX_INDEX)] = zeros_field(0, dtype=np.int64)
    # As in `ReportTrials`.
    cell: Annotated[IntArray, integers("E", 0, below="K")] = zeros_field(0, dtype=np.int64)
    expected: Annotated[FloatArray, floats("E", 0.0, MOST_EXPECTED)] = zeros_field(0)
    detected: Annotated[FloatArray, floats("E", 0.0, 1.0)] = zeros_field(0)
    # Share of each trial that is open.
    open_share: Annotated[FloatArray, floats("E", 0.0, 1.0, key="still")] = zeros_field(0)

    def __len__(self) -> int:
        return len(self.label)

    def take(self, rows: IntArray | BoolArray) -> OpenTrials:
        """Return these trials."""
        return OpenTrials(
            self.label[rows],
            self.cell[rows],
            self.expected[rows],
            self.detected[rows],
            self.open_share[rows],
        )

    def of(self, labels: IntArray) -> OpenTrials:
        """Return the trials for the targets of ascending labels."""
        return self.take(contains(labels, self.label))

    def after(self, trials: ReportTrials, cells: int) -> tuple[OpenTrials, FloatArray]:
        """Return the open trials after a report, and sums over those that count now.

        `cells` is the number of all sensors' cells, K; the sums are the columns of `TrialSums`,
        (3, K). If a target is detected with probability d, given that it exists, the share d of its
        open trials counts, times its existence probability. The share 1 - d stays open, and so does
        the report's own trial for it.
        """
        label, cell, (expected, detected, open_share), counted = _count_trials(
            *(
                LEAST_OPEN,
                cells,
                self.label,
                self.cell,
                self.expected,
                self.detected,
                self.open_share,
            ),
            *contiguous(*trials),
        )
        trials_left = self.changed(
            label=label, cell=cell, expected=expected, detected=detected, open_share=open_share
        )
        return trials_left, counted


@compiled
def _count_trials(
    least: float,
    cells: int,
    label: Int1,
    cell: Int1,
    expected: Float1,
    detected: Float1,
    share: Float1,
    own_label: Int1,
    own_cell: Int1,
    own_expected: Float1,
    own_detected: Float1,
    existence: Float1,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return the columns of `OpenTrials` and of `TrialSums` after a report.

    The last three columns of `OpenTrials` are one array, (3, E), and those of the sums another,
    (3, K). The last arguments, from `own_label` on, are the columns of the report's `ReportTrials`.
    """
    size, targets, count = len(label), len(own_label), 0
    sums, capacity = np.zeros((3, cells)), size + targets
    labels, places = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    values = np.empty((3, capacity))
    for trial in range(size):
        target, detected_now = count_below(own_label, label[trial]), 0.0
        if target < targets and own_label[target] == label[trial]:
            detected_now = own_detected[target]
            counted = detected_now * existence[target] * share[trial]
            sums[0, cell[trial]] += counted
            sums[1, cell[trial]] += counted * expected[trial]
            sums[2, cell[trial]] += counted * detected[trial]
        remaining = (1.0 - detected_now) * share[trial]
        if remaining > least:
            labels[count], places[count] = label[trial], cell[trial]
            values[0, count], values[1, count] = expected[trial], detected[trial]
            values[2, count] = remaining
            count += 1
    for target in range(targets):
        if own_expected[target] > 0.0:
            labels[count], places[count] = own_label[target], own_cell[target]
            values[0, count], values[1, count] = own_expected[target], own_detected[target]
            values[2, count] = 1.0
            count += 1
    return labels[:count].copy(), places[:count].copy(), values[:, :count].copy(), sums
