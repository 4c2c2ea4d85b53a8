"""Comparison of the estimates of one scan with its targets, in total and per class."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.types import COASTING, Estimates, Truth

from .identity import IdentitySwitches
from .limits import OSPA2_WINDOW
from .mahalanobis import mahalanobis2
from .metrics import Gospa, Ospa, assign, gospa, ospa
from .surveillance import BoolArray, Gap, GapFinder, LabelledPoints, TrackWindow
from .track_ages import TrackAges

ALL = "all"
# Index of the target and of the estimate of each pair, as `metrics.assign` returns them.
Pairs = tuple[IntArray, IntArray]


def set_names(classes: int) -> tuple[str, ...]:
    """Return the names of the compared sets: ``all``, and one ``class_k`` per class."""
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
        0 for an unlabelled point; None if all are unlabelled.
    velocity : array of shape (T, 2) or None
        Metres per second; None if it is not known.
    covariance : array of shape (T, 2, 2) or None
        Of the positions, square metres; None if it is not known, as of the truth.
    height : array of shape (T,) or None
        Metres; NaN, and None for all, if it is not known.
    coasting : bool array of shape (T,) or None
        Which tracks had no detection in their last scan or turn; None if that is not known.
    """

    position: FloatArray
    class_id: IntArray
    track_id: IntArray | None = None
    velocity: FloatArray | None = None
    covariance: FloatArray | None = None
    height: FloatArray | None = None
    coasting: BoolArray | None = None

    @staticmethod
    def of(targets: Truth | Estimates) -> PointSet:
        """Return the points of targets or estimates."""
        covariance, heights, coasting = None, None, None
        if isinstance(targets, Truth):
            heights = targets.height
        else:
            covariance = targets.position_covariance
            coasting = targets.track_state == COASTING
            if targets.attributes is not None:
                heights = targets.attributes.height
        return PointSet(
            *(targets.position, targets.class_id, targets.track_id, targets.velocity, covariance),
            None if heights is None else heights[:, 0],
            coasting,
        )

    def __len__(self) -> int:
        return len(self.position)

    def of_class(self, class_id: int) -> PointSet:
        """Return the points of one class."""
        return self.only(np.flatnonzero(self.class_id == class_id))

    def only(self, index: IntArray) -> PointSet:
        """Return the points of the given indices."""
        label = None if self.track_id is None else self.track_id[index]
        velocity = None if self.velocity is None else self.velocity[index]
        covariance = None if self.covariance is None else self.covariance[index]
        height = None if self.height is None else self.height[index]
        return PointSet(
            *(self.position[index], self.class_id[index], label, velocity, covariance, height),
            None if self.coasting is None else self.coasting[index],
        )

    def labelled(self) -> LabelledPoints | None:
        """Return the points with their labels; None unless all labels are non-zero and distinct."""
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
        As of `metrics.assign`.
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
    """One set of estimates compared with one set of targets at one scan; input of the metrics.

    Parameters
    ----------
    truth, estimate : PointSet
    paired_truth, paired_estimate : PointSet
        The set's targets that are paired with an estimate by position alone, and these estimates,
        which may be of any class.
    age : int array of shape (P,)
        Of the tracks of `paired_estimate`, see `TrackAges`.
    cutoff : float
        c, metres.
    order : float
        p.
    gaps : tuple of Gap or None
        Gaps of the set's targets that ended in the scan; None if a target has no label.
    ospa2 : float or None
        OSPA(2) of the newest scans, metres; None for a single class, or if a target or an estimate
        has no label.
    identity_switches, seen_switches : int or None
        Of the scan, and without new pairs of tracks that coast; None as for `ospa2`.
    """

    truth: PointSet
    estimate: PointSet
    paired_truth: PointSet
    paired_estimate: PointSet
    age: IntArray
    cutoff: float
    order: float
    gaps: tuple[Gap, ...] | None
    ospa2: float | None
    identity_switches: int | None
    seen_switches: int | None

    @cached_property
    def ospa(self) -> Ospa:
        """The OSPA distance and its parts."""
        return ospa(self.truth.position, self.estimate.position, self.cutoff, self.order)

    @cached_property
    def gospa(self) -> Gospa:
        """The GOSPA distance and its parts."""
        return gospa(self.truth.position, self.estimate.position, self.cutoff, self.order)

    @cached_property
    def mahalanobis2(self) -> FloatArray:
        """Squared Mahalanobis distances of the pairs, shape (P,); NaN without a covariance."""
        error = self.paired_truth.position - self.paired_estimate.position
        return mahalanobis2(error, self.paired_estimate.covariance)

    @property
    def height_error(self) -> FloatArray:
        """Errors of the pairs whose heights are known, metres, shape (Q,)."""
        true, found = self.paired_truth.height, self.paired_estimate.height
        if true is None or found is None:
            return np.zeros(0)
        error = found - true
        return error[np.isfinite(error)]

    def of_class(self, class_id: int) -> Comparison:
        """Return the comparison of one class alone."""
        pairs = np.flatnonzero(self.paired_truth.class_id == class_id)
        return replace(
            self,
            truth=self.truth.of_class(class_id),
            estimate=self.estimate.of_class(class_id),
            paired_truth=self.paired_truth.only(pairs),
            paired_estimate=self.paired_estimate.only(pairs),
            age=self.age[pairs],
            gaps=None if self.gaps is None else _of_set(self.gaps, class_set(class_id)),
            ospa2=None,
            identity_switches=None,
            seen_switches=None,
        )


class ScanComparer:
    """Compares a source's scans with the truth, in order.

    It keeps the part of earlier scans that gaps, OSPA(2), identity switches and ages need.

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
        self._identities = IdentitySwitches(cutoff)
        self._seen_identities = IdentitySwitches(cutoff)
        self._ages = TrackAges()
        self._newest_ns: int | None = None

    def compare(self, scan: PairedScan) -> dict[str, Comparison]:
        """Return the comparison of each set at the next scan."""
        ospa2, switches, seen_switches = self._of_tracks(scan)
        age = self._ages.add(scan.stamp_ns, scan.estimate.track_id, len(scan.estimate))
        everything = Comparison(
            scan.truth,
            scan.estimate,
            scan.truth.only(scan.pairs[0]),
            scan.estimate.only(scan.pairs[1]),
            age[scan.pairs[1]],
            self._cutoff,
            self._order,
            self._ended_gaps(scan),
            ospa2,
            switches,
            seen_switches,
        )
        classes = {class_set(k): everything.of_class(k) for k in range(self._classes)}
        return {ALL: everything, **classes}

    def ended(self, newest: Mapping[str, Comparison]) -> dict[str, Comparison]:
        """Return the newest scan's comparisons as if the run, and all open gaps, ended with it."""
        still_open = tuple(self._finder.under_way())
        return {
            key: scan
            if scan.gaps is None
            else replace(scan, gaps=(*scan.gaps, *_of_set(still_open, key)))
            for key, scan in newest.items()
        }

    def _ended_gaps(self, scan: PairedScan) -> tuple[Gap, ...] | None:
        points = scan.truth.labelled()
        if points is None:
            return None
        paired = np.zeros(len(scan.truth), dtype=np.bool_)
        paired[scan.pairs[0]] = True
        return tuple(self._finder.add(scan.stamp_ns, points.label, scan.truth.class_id, paired))

    def _of_tracks(self, scan: PairedScan) -> tuple[float | None, int | None, int | None]:
        """Return OSPA(2) and both numbers of identity switches; None without labels."""
        truth, estimate = scan.truth.labelled(), scan.estimate.labelled()
        if truth is None or estimate is None:
            self._forget_tracks()
            return None, None, None
        if self._newest_ns is not None and scan.stamp_ns < self._newest_ns:
            self._forget_tracks()
        self._newest_ns = scan.stamp_ns
        self._window.add(truth, estimate)
        distance = self._window.ospa2(self._cutoff, self._order).distance
        seen_switches = self._seen_identities.add(truth, estimate, scan.estimate.coasting)
        return distance, self._identities.add(truth, estimate), seen_switches

    def _forget_tracks(self) -> None:
        self._window.clear()
        self._identities.clear()
        self._seen_identities.clear()


def _of_set(gaps: tuple[Gap, ...], key: str) -> tuple[Gap, ...]:
    return tuple(gap for gap in gaps if key in (ALL, class_set(gap.class_id)))


@dataclass(frozen=True)
class ScanScore:
    """The score of one source at one stamp.

    Parameters
    ----------
    source : str
        ``filtered`` or ``smoothed``.
    stamp_ns : int
    values : dict
        Values of `metric_table.VALUES` by set and name; None where there is no such value.
    """

    source: str
    stamp_ns: int
    values: dict[str, dict[str, float | None]]
