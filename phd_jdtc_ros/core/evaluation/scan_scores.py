# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""One scan's estimates against its targets, all of them and class by class."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arrays import FloatArray, IntArray
from ..types import Estimates, Truth
from .limits import OSPA2_WINDOW
from .metrics import Gospa, Ospa, assign, gospa, ospa
from .surveillance import Gap, GapFinder, LabelledPoints, TrackWindow

ALL = "all"
# Index of the target and of the estimate of each pair, as `metrics.assign` returns them.
Pairs = tuple[IntArray, IntArray]


def set_names(classes: int) -> tuple[str, ...]:
    """Return the sets that are compared: ``all``, and one ``class_k`` a class."""
    return (ALL, *map(class_set, range(classes)))


def class_set(class_id: int) -> str:
    """Return the name of a class's set."""
    return f"class_{class_id}"


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

    @staticmethod
    def of(targets: Truth | Estimates) -> PointSet:
        """Return what a comparison needs of targets or estimates."""
        return PointSet(targets.position, targets.class_id, targets.track_id)

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
class PairedScan:
    """The targets of a stamp and one source's estimates, paired by position alone.

    Parameters
    ----------
    stamp_ns : int
    truth, estimate : PointSet
    pairs : tuple of two int arrays of shape (P,)
        Of `assign`.
    """

    stamp_ns: int
    truth: PointSet
    estimate: PointSet
    pairs: Pairs

    @staticmethod
    def of(stamp_ns: int, truth: PointSet, estimate: PointSet, cutoff: float) -> PairedScan:
        """Pair targets and estimates that are closer than `cutoff`, metres."""
        return PairedScan(
            stamp_ns, truth, estimate, assign(truth.position, estimate.position, cutoff)
        )


@dataclass(frozen=True)
class Comparison:
    """One set of estimates against one set of targets at one scan: what metrics follow from.

    Parameters
    ----------
    truth, estimate : PointSet
    paired_truth, paired_estimate : PointSet
        The set's targets that have an estimate by position alone, and these estimates, which may
        be of any class.
    cutoff : float
        c, metres.
    order : float
        p.
    gaps : tuple of Gap or None
        Of the set's targets, those that ended with the scan; None if a target has no label.
    ospa2 : float or None
        Of the newest scans, metres; None unless all targets and estimates have labels, and for a
        single class.
    """

    truth: PointSet
    estimate: PointSet
    paired_truth: PointSet
    paired_estimate: PointSet
    cutoff: float
    order: float
    gaps: tuple[Gap, ...] | None
    ospa2: float | None

    @cached_property
    def ospa(self) -> Ospa:
        """The OSPA distance and its parts."""
        return ospa(self.truth.position, self.estimate.position, self.cutoff, self.order)

    @cached_property
    def gospa(self) -> Gospa:
        """The GOSPA distance and its parts."""
        return gospa(self.truth.position, self.estimate.position, self.cutoff, self.order)

    def of_class(self, class_id: int) -> Comparison:
        """Return the comparison of one class alone."""
        pairs = np.flatnonzero(self.paired_truth.class_id == class_id)
        return replace(
            self,
            truth=self.truth.of_class(class_id),
            estimate=self.estimate.of_class(class_id),
            paired_truth=self.paired_truth.only(pairs),
            paired_estimate=self.paired_estimate.only(pairs),
            gaps=None if self.gaps is None else _of_set(self.gaps, class_set(class_id)),
            ospa2=None,
        )


class ScanComparer:
    """Compares a source's scans with the truth, one after the other.

    Of earlier scans it remembers what gaps and OSPA(2) need.

    Parameters
    ----------
    classes : int
    cutoff : float
        c, metres.
    order : float
        p.
    """

    def __init__(self, classes: int, cutoff: float, order: float) -> None:
        self._classes, self._cutoff, self._order = classes, cutoff, order
        self._finder = GapFinder()
        self._window = TrackWindow(OSPA2_WINDOW)
        self._newest_ns: int | None = None

    def compare(self, scan: PairedScan) -> dict[str, Comparison]:
        """Return the comparison of each set at the next scan."""
        everything = Comparison(
            scan.truth,
            scan.estimate,
            scan.truth.only(scan.pairs[0]),
            scan.estimate.only(scan.pairs[1]),
            self._cutoff,
            self._order,
            self._ended_gaps(scan),
            self._ospa2(scan),
        )
        classes = {class_set(k): everything.of_class(k) for k in range(self._classes)}
        return {ALL: everything, **classes}

    def ended(self, newest: Mapping[str, Comparison]) -> dict[str, Comparison]:
        """Return the newest scan's comparisons as if the run ended there, and all gaps with it."""
        more = tuple(self._finder.under_way())
        return {
            key: scan
            if scan.gaps is None
            else replace(scan, gaps=(*scan.gaps, *_of_set(more, key)))
            for key, scan in newest.items()
        }

    def _ended_gaps(self, scan: PairedScan) -> tuple[Gap, ...] | None:
        points = scan.truth.labelled()
        if points is None:
            return None
        found = np.zeros(len(scan.truth), dtype=np.bool_)
        found[scan.pairs[0]] = True
        return tuple(self._finder.add(scan.stamp_ns, points.label, scan.truth.class_id, found))

    def _ospa2(self, scan: PairedScan) -> float | None:
        true, found = scan.truth.labelled(), scan.estimate.labelled()
        if true is None or found is None:
            self._window.clear()
            return None
        if self._newest_ns is not None and scan.stamp_ns < self._newest_ns:
            self._window.clear()
        self._newest_ns = scan.stamp_ns
        self._window.add(true, found)
        return self._window.ospa2(self._cutoff, self._order).distance


def _of_set(gaps: tuple[Gap, ...], key: str) -> tuple[Gap, ...]:
    return tuple(gap for gap in gaps if key in (ALL, class_set(gap.class_id)))


@dataclass(frozen=True)
class ScanScore:
    """How one source did at one stamp.

    Parameters
    ----------
    source : str
        ``filtered`` or ``smoothed``.
    stamp_ns : int
    values : dict
        By set and name, those of `metric_table.VALUES`; None where there is no such value.
    """

    source: str
    stamp_ns: int
    values: dict[str, dict[str, float | None]]
