# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""One scan's estimates against its targets, all of them and class by class."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray, IntArray
from .metrics import Gospa, Ospa, gospa, ospa
from .surveillance import LabelledPoints

ALL = "all"
# Index of the target and of the estimate of each pair, as `metrics.assign` returns them.
Pairs = tuple[IntArray, IntArray]


@dataclass(frozen=True)
class PointSet:
    """Classified positions at one stamp.

    Parameters
    ----------
    position : array of shape (T, 2)
        World frame, metres.
    class_id : int array of shape (T,)
    track_id : int array of shape (T,) or None
        0 is unlabelled; None if all are.
    """

    position: FloatArray
    class_id: IntArray
    track_id: IntArray | None = None

    def __len__(self) -> int:
        return len(self.position)

    def of_class(self, class_id: int) -> PointSet:
        """Return the points of one class."""
        return self.only(np.flatnonzero(self.class_id == class_id))

    def only(self, index: IntArray) -> PointSet:
        """Return some of the points."""
        label = None if self.track_id is None else self.track_id[index]
        return PointSet(self.position[index], self.class_id[index], label)

    def labelled(self) -> LabelledPoints | None:
        """Return the points with their labels, None unless each has one of its own."""
        label = np.zeros(len(self), dtype=np.int64) if self.track_id is None else self.track_id
        if not label.all() or len(np.unique(label)) < len(label):
            return None
        return LabelledPoints(label, self.position)


@dataclass(frozen=True)
class Score:
    """One set of estimates against one set of targets.

    Parameters
    ----------
    ospa : Ospa
    gospa : Gospa
    n_true, n_est : int
    pairs : int
        The set's targets with an estimate assigned by position alone, closer than the cutoff.
    square_error : float
        Sum of these pairs' squared distances, square metres.
    """

    ospa: Ospa
    gospa: Gospa
    n_true: int
    n_est: int
    pairs: int
    square_error: float


@dataclass(frozen=True)
class ScanScore:
    """How one source did at one stamp.

    Parameters
    ----------
    source : str
        ``filtered`` or ``smoothed``.
    stamp_ns : int
    scores : dict
        Key ``all`` and one ``class_k`` a class.
    right_class : int
        The pairs of all targets that have the target's class.
    """

    source: str
    stamp_ns: int
    scores: dict[str, Score]
    right_class: int

    @property
    def pairs(self) -> int:
        """Estimates assigned to a target by position alone, closer than the cutoff."""
        return self.scores[ALL].pairs


def set_scores(
    truth: PointSet, estimate: PointSet, pairs: Pairs, classes: int, cutoff: float, order: float
) -> dict[str, Score]:
    """Return the scores of one scan, of all targets and of those of each class.

    Parameters
    ----------
    truth, estimate : PointSet
    pairs : tuple of two int arrays of shape (P,)
        Of `assign`.
    classes : int
    cutoff : float
        c of OSPA and GOSPA, metres.
    order : float
        p of both.
    """
    target, found = pairs
    distance = truth.position[target] - estimate.position[found]
    square = np.einsum("ij,ij->i", distance, distance)
    of_class = truth.class_id[target]
    sets = {ALL: (truth, estimate, square)}
    for k in range(classes):
        sets[f"class_{k}"] = (truth.of_class(k), estimate.of_class(k), square[of_class == k])
    return {
        key: Score(
            ospa=ospa(t.position, e.position, cutoff, order),
            gospa=gospa(t.position, e.position, cutoff, order),
            n_true=len(t),
            n_est=len(e),
            pairs=len(errors),
            square_error=float(errors.sum()),
        )
        for key, (t, e, errors) in sets.items()
    }
