"""Looks at targets that do not count yet, because no later detection shows that the target was there.

A miss has two explanations: the sensor did not detect the target, or the target was no longer
there. Between two detections of a target only the first one is left. Therefore a look, detection
or miss, counts when the target is detected again, by any sensor. A target's first detection never
counts, because there would be no target without it, nor does its last one, nor what follows it: when
a target disappears, or was false, its open looks disappear with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, contains, read_only
from ..snapshot import MAX_INDEX, floats, integers

# Looks of which less is open are dropped.
LEAST_OPEN = 1e-3
# Largest number of looks accepted in a snapshot.
MAX_LOOKS = 1 << 20


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
    cell : int array
        See `Looks`.
    expected, detected : arrays
        Expected and actual detections that are open.
    """

    label: Annotated[IntArray, integers("E", 0, MAX_INDEX)] = field(default_factory=_no_labels)
    cell: Annotated[IntArray, integers("E", 0, MAX_INDEX)] = field(default_factory=_no_labels)
    expected: Annotated[FloatArray, floats("E", 0.0, 1e3)] = field(default_factory=_none)
    detected: Annotated[FloatArray, floats("E", 0.0, 1.0 + 1e-6)] = field(default_factory=_none)

    def __post_init__(self) -> None:
        for name in ("label", "cell"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))
        for name in ("expected", "detected"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.label)

    def take(self, rows: IntArray | BoolArray) -> OpenLooks:
        """Return these looks."""
        return OpenLooks(
            self.label[rows], self.cell[rows], self.expected[rows], self.detected[rows]
        )

    def of(self, labels: IntArray) -> OpenLooks:
        """Return the looks at the targets of ascending labels."""
        return self.take(contains(labels, self.label))

    def after(self, looks: Looks, cells: int) -> tuple[OpenLooks, FloatArray, FloatArray]:
        """Return the open looks after a report, and the looks that count now.

        Parameters
        ----------
        cells : int
            Number of all sensors' cells, K.

        Returns
        -------
        OpenLooks
        expected, detected : arrays of shape (K,)
            Expected and actual detections that count now, by cell.

        Notes
        -----
        A target that is detected with probability d, given that it exists, has the share d of its
        open looks count, times its existence probability. The share 1 - d stays open, and so does
        the look itself.
        """
        place = np.minimum(looks.label.searchsorted(self.label), max(len(looks.label) - 1, 0))
        now = np.zeros(len(self))
        counts = now
        if len(looks.label):
            here = looks.label[place] == self.label
            now = np.where(here, looks.detected[place], 0.0)
            counts = now * looks.existence[place]
        expected = np.bincount(self.cell, counts * self.expected, minlength=cells)
        detected = np.bincount(self.cell, counts * self.detected, minlength=cells)
        new = looks.expected > 0.0
        columns = (
            np.concatenate([self.label, looks.label[new]]),
            np.concatenate([self.cell, looks.cell[new]]),
            np.concatenate([(1.0 - now) * self.expected, looks.expected[new]]),
            np.concatenate([(1.0 - now) * self.detected, looks.detected[new]]),
        )
        left = OpenLooks(*columns)
        return left.take(left.expected > LEAST_OPEN), expected, detected
