"""Estimates and targets of one scan, for all classes and per class."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.types import COASTING, Estimates, Truth

from .metrics import assign

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
        """Return the points of targets or estimates."""
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


def expected_speed(velocity: FloatArray, covariance: FloatArray | None) -> FloatArray:
    """Return the expected ground speeds, metres per second, (T,), of uncertain velocities, (T, 2).

    The length of the mean velocity is below the mean speed, because the course is uncertain. The
    velocity's variance across the course, if known, corrects this to second order.
    """
    length: FloatArray = np.hypot(*velocity.T)
    if covariance is None:
        return length
    course = velocity / np.maximum(length, np.finfo(float).tiny)[:, None]
    across = np.column_stack([-course[:, 1], course[:, 0]])
    variance = np.einsum("ti,tij,tj->t", across, covariance, across)
    return np.asarray(np.sqrt(length**2 + variance))


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
