"""The recursion in closed form: the steps of a scan in order, and backward along their lineages.

The smoother of Sec. III-B multiplies D_{t|t}(x) by 1 - P_s + P_s times the integral over y of
f(y|x) D_{t+1|k}(y) / D_{t+1|t}(y). The ratio in it is the factor of the correction at t+1 times
that of the smoother at t+1. So a Gaussian s of D_{t|t} times the integral is a sum over its
descendants q, the Gaussians of D_{t+1|t+1} that came from s: each has the smoothed weight of q, and
the moments of a Rauch-Tung-Striebel step back from the smoothed q. One Gaussian with the moments of
the sum takes its place. Births and spawned targets are in D_{t+1|t} and not in the integral, so
that they pass no weight back.

Where descendants were merged, the smoothed weight of the merged Gaussian is divided in proportion
to their weights before the merging, and the step of each begins at the smoothed merged one.

References
----------
Vo, Vo and Mahler, "Closed-form solutions to forward-backward smoothing", IEEE Transactions on
Signal Processing 60(1), 2012, whose backward correctors have the same terms.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by
from ..models.tracker_model import TrackerModel
from ..types import Estimates, Scan
from .engine import Stepped
from .extraction import estimates, groups_above
from .gaussian_mixture import (
    Mixture,
    Predicted,
    Updated,
    correct,
    inverses,
    moments,
    predict,
    reduce,
)
from .smoothing import bernoulli_death_term


class Lineage(NamedTuple):
    """The surviving descendants, in a stored mixture, of the Gaussians of the one before.

    Given the state y of a descendant, its parent's is Gaussian with the mean m + G y, with the gain
    G of the Rauch-Tung-Striebel step.
    """

    survival: FloatArray  # P_s of each Gaussian of the earlier mixture, (J_t,)
    parent: IntArray  # Row of each descendant's parent in the earlier mixture, (I,)
    row: IntArray  # Row in the later mixture with which it was merged, (I,)
    share: FloatArray  # Its share in the weight of that row, (I,)
    gain: FloatArray  # G, (I, D, D)
    mean: FloatArray  # Means m, (I, D)
    covariance: FloatArray  # Covariance of the parent's state, given y, (I, D, D)


def trace(
    earlier: Mixture,
    predicted: Predicted,
    updated: Updated,
    stored: Mixture,
    row: IntArray,
    survival: FloatArray,
) -> Lineage:
    """Return the lineage from one stored mixture to the next.

    `row` has the row of each updated Gaussian in the next one, and `survival` has P_s of each
    Gaussian of the earlier one.
    """
    (index,) = (updated.source < len(predicted.parent)).nonzero()
    source, row = updated.source[index], row[index]
    parent, before = predicted.parent[source], predicted.mixture.covariance[source]
    gain = predicted.cross[source] @ inverses(before)
    step = gain @ predicted.mixture.mean[source][..., None]
    return Lineage(
        survival,
        parent=parent,
        row=row,
        share=updated.mixture.weight[index] / stored.weight[row],
        gain=gain,
        mean=earlier.mean[parent] - step[..., 0],
        covariance=earlier.covariance[parent] - gain @ before @ gain.swapaxes(1, 2),
    )


def backward_step(mixture: Mixture, lineage: Lineage, later: Mixture) -> Mixture:
    """Return the smoothed mixture at t, given the filtered one and the smoothed next one.

    Deviation from Sec. II-B: the death term of a component is that of a Bernoulli target, see
    `smoothing.bernoulli_death_term`. A target that died keeps its filtered moments.
    """
    parent, row, size = lineage.parent, lineage.row, len(mixture)
    weight = later.weight[row] * lineage.share
    alive, surviving = sum_by(parent, weight, size), lineage.survival * mixture.weight
    part, parts = mixture.component, int(mixture.component.max(initial=-1)) + 1
    explained = part >= 0

    def by_component(value: FloatArray) -> FloatArray:
        return sum_by(part[explained], value[explained], parts)

    factor = np.ones(size)
    masses = by_component(mixture.weight), by_component(surviving), by_component(alive)
    factor[explained] = bernoulli_death_term(*masses)[part[explained]]
    dead = (mixture.weight - surviving) * factor

    gain = lineage.gain
    mean = lineage.mean + (gain @ later.mean[row][..., None])[..., 0]
    covariance = lineage.covariance + gain @ later.covariance[row] @ gain.swapaxes(1, 2)
    smoothed = moments(
        np.append(dead, weight),
        np.concatenate([mixture.mean, mean]),
        np.concatenate([mixture.covariance, covariance]),
        np.append(np.arange(size), parent),
        near=mixture.mean,
    )
    return mixture.changed(**smoothed._asdict())


@dataclass
class GaussianFilter:
    """The Gaussian mixture PHD filter and smoother; implements `engine.Recursion`."""

    model: TrackerModel
    _scans: int = field(init=False, default=0, repr=False)  # Scans since the start

    def reset(self) -> None:
        """Return to the initial state."""
        self._scans = 0

    def step(
        self, earlier: Mixture | None, scan: Scan, dt: float, linked: bool
    ) -> Stepped[Mixture, Lineage]:
        """Predict, correct with every radar, and merge; if `linked`, trace the lineage."""
        modes = self.model.modes
        start = Mixture.empty(len(modes.space)) if earlier is None else earlier
        predicted = predict(start, self.model, dt, self._scans)
        updated = Updated(predicted.mixture, np.arange(len(predicted.mixture)))
        for report in self.model.expected(scan):
            updated = correct(updated, report, modes)
        stored, row = reduce(updated.mixture, modes)
        self._scans += 1
        link = None
        if linked and earlier is not None:
            survival = modes.survival(dt)[earlier.mode]
            link = trace(earlier, predicted, updated, stored, row, survival)
        return Stepped(stored, stored, link, {"gaussians": len(stored)})

    def backward_step(self, stored: Mixture, link: Lineage, later: Mixture) -> Mixture:
        """Return the smoothed mixture, given the smoothed next one."""
        return backward_step(stored, link, later)

    def extract(self, found: Mixture, stamp_ns: int, lag: int, threshold: float) -> Estimates:
        """Return the components, and the (origin, class) groups of the Poisson part, as targets.

        They are those whose mass is above the threshold; see `extraction.components`.
        """
        modes, rows = self.model.modes, np.arange(len(found))
        first = int(found.component.max(initial=-1)) + 1
        unexplained = first + found.origin * len(modes.classes) + modes.class_of[found.mode]
        key = np.where(found.component < 0, unexplained, found.component)
        groups = groups_above(threshold, key, rows, found.weight)

        def moments_of(
            row: IntArray, group: IntArray, weight: FloatArray
        ) -> tuple[FloatArray, FloatArray]:
            leader = np.zeros(int(group.max(initial=-1)) + 1, dtype=np.int64)
            leader[group] = row
            columns = found.mean[row], found.covariance[row], group
            return moments(weight, *columns, near=found.mean[leader])[1:]

        return estimates(groups, found.mode, modes, moments_of, stamp_ns, lag)

    def class_mass(self, found: Mixture) -> FloatArray:
        """Return the expected number of targets of each class, shape (C,)."""
        modes = self.model.modes
        return sum_by(modes.class_of[found.mode], found.weight, len(modes.classes))
