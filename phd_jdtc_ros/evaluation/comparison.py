"""Estimates and targets of one scan, for all classes and per class, and the truth at any time."""

from __future__ import annotations

from bisect import bisect_left, insort
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.types import COASTING, Estimates, Truth

from .metrics import assign

# Longest interval between samples over which the truth is interpolated, seconds.
LONGEST_INTERPOLATION_S = 10.0


class TrueTracks:
    """Samples of the true targets, the newest `keep` or all, and the targets between two samples.

    At the stamp of a sample the truth is that sample. A target exists between two samples if it
    exists in both. Its path is the cubic through both positions with both velocities (Hermite), or
    a straight line if velocities are unknown. There is no interpolation over more than
    `LONGEST_INTERPOLATION_S`, or of targets without labels.
    """

    def __init__(self, keep: int | None = None) -> None:
        self._keep = keep
        self._samples: dict[int, PointSet] = {}
        self._stamps: list[int] = []

    def add(self, stamp_ns: int, truth: PointSet) -> None:
        """Add a sample, or replace the one of its stamp; remove the oldest beyond `keep`."""
        if self._samples.pop(stamp_ns, None) is None:
            insort(self._stamps, stamp_ns)
        self._samples[stamp_ns] = truth
        while self._keep is not None and len(self._samples) > self._keep:
            oldest = next(iter(self._samples))
            del self._samples[oldest], self._stamps[bisect_left(self._stamps, oldest)]

    def __contains__(self, stamp_ns: int) -> bool:
        """Return whether there is a sample of this stamp."""
        return stamp_ns in self._samples

    def __len__(self) -> int:
        return len(self._samples)

    def at(self, stamp_ns: int) -> PointSet | None:
        """Return the targets at a time; None if unknown, or not yet known."""
        if stamp_ns in self._samples:
            return self._samples[stamp_ns]
        after = bisect_left(self._stamps, stamp_ns)
        if not 0 < after < len(self._stamps):
            return None
        begin, end = self._stamps[after - 1], self._stamps[after]
        if end - begin > LONGEST_INTERPOLATION_S * 1e9:
            return None
        part = (stamp_ns - begin) / (end - begin)
        return interpolate(self._samples[begin], self._samples[end], part, (end - begin) * 1e-9)


def interpolate(
    first: PointSet, second: PointSet, part: float, interval_s: float
) -> PointSet | None:
    """Return the targets that exist in two samples, at a time between the samples.

    `part`, between 0 and 1, is the elapsed share of the interval, which lasts `interval_s` seconds.
    The targets are in the order of the first sample; None unless all have labels.
    """
    labelled = first.with_labels(), second.with_labels()
    if labelled[0] is None or labelled[1] is None:
        return None
    _, row, column = np.intersect1d(labelled[0].label, labelled[1].label, return_indices=True)
    order = np.argsort(row)
    begin, end = first.only(row[order]), second.only(column[order])
    rest = 1.0 - part
    position = rest * begin.position + part * end.position
    velocity = None
    if begin.velocity is not None and end.velocity is not None:
        # The cubic corrects for the difference of each end's velocity from the mean velocity.
        mean = (end.position - begin.position) / interval_s
        bends = rest * (begin.velocity - mean) - part * (end.velocity - mean)
        position = position + interval_s * part * rest * bends
        velocity = rest * begin.velocity + part * end.velocity
    return PointSet(position, begin.class_id, begin.track_id, velocity)


def without_slow(
    truth: PointSet, estimate: PointSet, least_speed: float, near: float
) -> tuple[PointSet, PointSet]:
    """Return targets and estimates of a stamp without slow targets and their estimates.

    Some trackers leave out slow targets by design, such as ships at anchor. A target is slow below
    `least_speed`, m/s, and `near` is the largest distance of a target and its estimate in the
    assignment by position, metres. All are returned if the velocities of the truth are unknown.
    """
    if least_speed <= 0.0 or truth.velocity is None:
        return truth, estimate
    slow = np.hypot(*truth.velocity.T) < least_speed
    target, row = assign(truth.position, estimate.position, near)
    rest = np.setdiff1d(np.arange(len(estimate)), row[slow[target]])
    return truth.only(np.flatnonzero(~slow)), estimate.only(rest)


ALL = "all"
# Index of the target and of the estimate of each pair, as `metrics.assign` returns them.
Pairs = tuple[IntArray, IntArray]


def set_names(classes: int) -> tuple[str, ...]:
    """Return the names of the compared sets: ``all``, and one ``class_k`` per class."""
    return (ALL, *map(class_set, range(classes)))


def class_set(class_id: int) -> str:
    """Return the name of a class's set."""
    return f"class_{class_id}"


class LabelledPoints(NamedTuple):
    """The positions of one scan with their labels."""

    label: IntArray  # Label of each position's track, (T,); 0 for none
    position: FloatArray  # Metres, (T, 2)


@dataclass(frozen=True)
class PointSet:
    """Classified positions at one stamp."""

    position: FloatArray  # World frame, metres, (T, 2)
    class_id: IntArray  # (T,)
    track_id: IntArray | None = None  # (T,); 0 for an unlabelled point, None if all are unlabelled
    velocity: FloatArray | None = None  # Metres per second, (T, 2); None if unknown
    # Covariance of the positions, square metres, (T, 2, 2); None if unknown, as for the truth.
    covariance: FloatArray | None = None
    height: FloatArray | None = None  # Metres, (T,); NaN where unknown, None if all are unknown
    # True if each track had no detection in its last scan or revolution, (T,); None if unknown.
    coasting: BoolArray | None = None
    # Covariance of the velocities, (m/s)^2, (T, 2, 2); None if unknown.
    velocity_covariance: FloatArray | None = None
    climb: FloatArray | None = None  # Climb rate, m/s, (T,); as `height`
    # Covariance of x, y, z and their velocities, (T, 6, 6); NaN where the height is unknown, None
    # for the truth and for estimates in the plane.
    space_covariance: FloatArray | None = None

    @staticmethod
    def of(targets: Truth | Estimates) -> PointSet:
        """Return true targets, or estimates with what is known of them, as points."""
        covariance, heights, coasting, in_space = None, None, None, None
        if isinstance(targets, Truth):
            heights = targets.height
        else:
            covariance = targets.position_covariance
            coasting = targets.track_state == COASTING
            if targets.attributes is not None:
                heights = targets.attributes.height
            if targets.space.vertical:
                in_space = targets.covariance_in_space
        return PointSet(
            targets.position,
            targets.class_id,
            track_id=targets.track_id,
            velocity=targets.velocity,
            covariance=covariance,
            height=None if heights is None else heights[:, 0],
            coasting=coasting,
            climb=None if heights is None else heights[:, 1],
            space_covariance=in_space,
        )

    def __len__(self) -> int:
        return len(self.position)

    @property
    def place(self) -> FloatArray:
        """Positions with heights, metres, (T, 3); NaN for an unknown height."""
        height = np.full(len(self), np.nan) if self.height is None else self.height
        return np.column_stack([self.position, height])

    @property
    def motion(self) -> FloatArray:
        """Velocities with climb rates, metres per second, (T, 3); NaN for what is unknown."""
        unknown = np.full((len(self), 3), np.nan)
        if self.velocity is None or self.climb is None:
            return unknown
        return np.column_stack([self.velocity, self.climb])

    def of_class(self, class_id: int) -> PointSet:
        """Return the points of one class."""
        return self.only(np.flatnonzero(self.class_id == class_id))

    def only(self, index: IntArray) -> PointSet:
        """Return the points of the given indices."""
        known = {each.name: getattr(self, each.name) for each in fields(self)}
        return replace(
            self, **{n: column[index] for n, column in known.items() if column is not None}
        )

    def with_labels(self) -> LabelledPoints | None:
        """Return the points with their labels; None unless all labels are non-zero and distinct."""
        label = np.zeros(len(self), dtype=np.int64) if self.track_id is None else self.track_id
        if not label.all() or len(np.unique(label)) < len(label):
            return None
        return LabelledPoints(label, self.position)


def are_in_space(truth: PointSet, estimate: PointSet) -> bool:
    """Return whether estimates are in space and all true heights are known."""
    if estimate.space_covariance is None or truth.height is None:
        return False
    return bool(np.isfinite(truth.height).all())


@dataclass(frozen=True)
class PairedScan:
    """The targets of a stamp and one source's estimates, paired by position alone.

    Where estimates in space and all true heights are known, a position has a height: targets one
    above the other are at one place in the plane.
    """

    stamp_ns: int
    truth: PointSet
    estimate: PointSet
    pairs: Pairs  # Indices of paired targets and of their estimates; see `metrics.assign`

    @staticmethod
    def of(stamp_ns: int, truth: PointSet, estimate: PointSet, cutoff: float) -> PairedScan:
        """Pair targets and estimates that are closer than `cutoff`, metres."""
        true, found = truth.position, estimate.position
        if are_in_space(truth, estimate):
            # The plane decides on an estimate without a height.
            true, found = truth.place, estimate.place
            if np.isnan(found).any():
                true, found = truth.position, estimate.position
        return PairedScan(stamp_ns, truth, estimate, assign(true, found, cutoff))


@dataclass(frozen=True)
class Comparison:
    """One set of targets and estimates of a scan, from which metrics compute their values."""

    truth: PointSet
    estimate: PointSet
    # Indices in the scan of the set's targets, paired by position alone, and of their estimates.
    pairs: Pairs
    paired_truth: PointSet  # The targets of the P pairs
    paired_estimate: PointSet  # Their estimates, which may be of any class
    classes: int  # Number of compared classes
    class_id: int | None = None  # Class of the set; None for all targets
    last: bool = False  # True if the run ends with this scan

    @staticmethod
    def of(scan: PairedScan, classes: int) -> dict[str, Comparison]:
        """Return the comparisons of a scan, for all targets and for each class, by set name."""
        target, estimate = scan.pairs
        everything = Comparison(
            scan.truth,
            scan.estimate,
            scan.pairs,
            scan.truth.only(target),
            scan.estimate.only(estimate),
            classes,
        )
        return {ALL: everything, **{class_set(k): everything.of_class(k) for k in range(classes)}}

    @property
    def whole(self) -> bool:
        """Whether the set contains all targets."""
        return self.class_id is None

    def of_class(self, class_id: int) -> Comparison:
        """Return the comparison of one class alone."""
        rows = np.flatnonzero(self.paired_truth.class_id == class_id)
        return replace(
            self,
            truth=self.truth.of_class(class_id),
            estimate=self.estimate.of_class(class_id),
            pairs=(self.pairs[0][rows], self.pairs[1][rows]),
            paired_truth=self.paired_truth.only(rows),
            paired_estimate=self.paired_estimate.only(rows),
            class_id=class_id,
        )
