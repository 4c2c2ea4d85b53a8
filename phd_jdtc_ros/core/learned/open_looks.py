"""Looks at targets that do not count yet: no later detection shows that the target was there.

A miss has two explanations: the sensor did not detect the target, or the target was no longer
there. Between two detections of a target only the first one is left. Therefore a look, detection
or miss, counts when the target is detected again, by any sensor. A target's first detection never
counts, because there would be no target without it, nor does its last one, nor what follows it:
when a target disappears, or was false, its open looks disappear with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, contains, read_only, sum_by
from ..snapshot import MAX_INDEX, floats, integers

# Looks of which less is open are dropped.
LEAST_OPEN = 1e-3
# Largest number of expected detections of one look: a small learned factor can bring the
# configured probability above 1.
MOST_EXPECTED = 100.0


class Looks(NamedTuple):
    """Looks of one sensor at T targets in one report, arrays of shape (T,).

    Parameters
    ----------
    label : int array
        Ascending.
    cell : int array
        Number of the sensor's cell in which the target is, unique among sensors.
    expected : array
        Detections expected with the configured probability; 0 leaves the look out.
    detected : array
        Probability that the target was detected, if it exists.
    existence : array
        Existence probability after the report.
    """

    label: IntArray
    cell: IntArray
    expected: FloatArray
    detected: FloatArray
    existence: FloatArray


class Counted(NamedTuple):
    """Looks that count, sums by cell, arrays of shape (K,).

    Parameters
    ----------
    looks, expected, detected : arrays
        Number of looks, of detections expected with the configured probability, and of detections.
    """

    looks: FloatArray
    expected: FloatArray
    detected: FloatArray

    def part(self, cells: slice) -> Counted:
        """Return the sums of these cells."""
        return Counted(*(column[cells] for column in self))


def _none() -> FloatArray:
    return np.zeros(0)


def _no_labels() -> IntArray:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class OpenLooks:
    """Open looks, arrays of shape (E,).

    Parameters
    ----------
    label : int array
        Label of each look's target.
    cell, expected, detected : arrays
        See `Looks`.
    still : array
        Share of each look that is open.
    """

    label: Annotated[IntArray, integers("E", 0, MAX_INDEX)] = field(default_factory=_no_labels)
    cell: Annotated[IntArray, integers("E", 0, below="K")] = field(default_factory=_no_labels)
    expected: Annotated[FloatArray, floats("E", 0.0, MOST_EXPECTED)] = field(default_factory=_none)
    detected: Annotated[FloatArray, floats("E", 0.0, 1.0)] = field(default_factory=_none)
    still: Annotated[FloatArray, floats("E", 0.0, 1.0)] = field(default_factory=_none)

    def __post_init__(self) -> None:
        for name in ("label", "cell"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))
        for name in ("expected", "detected", "still"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

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

        Parameters
        ----------
        cells : int
            Number of all sensors' cells, K.

        Notes
        -----
        If a target is detected with probability d, given that it exists, the share d of its open
        looks counts, times its existence probability. The share 1 - d stays open, and so does the
        report's own look at it.
        """
        now = counting = np.zeros(len(self))
        if len(looks.label):
            place = np.minimum(looks.label.searchsorted(self.label), len(looks.label) - 1)
            now = np.where(looks.label[place] == self.label, looks.detected[place], 0.0)
            counting = now * looks.existence[place] * self.still
        counted = Counted(
            sum_by(self.cell, counting, cells),
            sum_by(self.cell, counting * self.expected, cells),
            sum_by(self.cell, counting * self.detected, cells),
        )
        still = (1.0 - now) * self.still
        left, new = still > LEAST_OPEN, looks.expected > 0.0
        return OpenLooks(
            np.concatenate([self.label[left], looks.label[new]]),
            np.concatenate([self.cell[left], looks.cell[new]]),
            np.concatenate([self.expected[left], looks.expected[new]]),
            np.concatenate([self.detected[left], looks.detected[new]]),
            np.concatenate([still[left], np.ones(np.count_nonzero(new))]),
        ), counted
