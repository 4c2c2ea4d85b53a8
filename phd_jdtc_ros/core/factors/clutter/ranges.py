"""Density of false detections over range: given as a table, learned, or both.

Echoes of the sea and of the ground are dense near a radar and end at its horizon. What differs from
place to place is the clutter map's; a law over range has few numbers and is known after few looks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Annotated, ClassVar

import numpy as np
from scipy.special import expit

from ...arrays import FloatArray, IntArray, read_only, sum_by, zeros_field
from ...sensors.view import View
from ...snapshot import floats, nested
from ..factor import Factor, Look
from .first_detections import FirstDetections

# Number of nodes of the learned density.
NODES = 12
# Memory of the learned law, as a number of false detections.
MEMORY = 1000.0
# Upper bound accepted in a snapshot: rounding may slightly exceed the memory.
MAX_COUNT = 1.001 * MEMORY
# Probability of the given density from which on it is the likelier one.
EVEN = 0.5
# Points between two nodes at which densities are integrated.
POINTS = 16
# Prior standard deviations of the log factor's change from one node to the next, in the mean over
# all nodes, and of how much one such change differs from the next.
CHANGE, BEND = 1.0, 0.5


@dataclass(frozen=True, eq=False)
class GivenDensity:
    """A density over range between limits, linear between points and constant beyond them."""

    limits: tuple[float, float]  # Smallest and largest range, metres
    distance: FloatArray  # Ranges of the points, metres, ascending, (P,)
    density: FloatArray  # Relative density at each point, (P,)

    def ratio(self, distance: FloatArray) -> FloatArray:
        """Return the ratio of the density at ranges, metres, to the uniform one, (M,)."""
        ratio: FloatArray = np.interp(distance, self.distance, self.density) / self._mean
        return ratio

    @cached_property
    def nodes(self) -> FloatArray:
        """Range of each node, metres, (K,)."""
        near, far = self.limits
        nodes: FloatArray = near + (far - near) * np.linspace(0.0, 1.0, NODES) ** 2
        return nodes

    @cached_property
    def share(self) -> FloatArray:
        """Probability of each of equal parts between nodes, (K - 1, POINTS)."""
        share: FloatArray = read_only(self._parts / self._parts.sum())
        return share

    @cached_property
    def _parts(self) -> FloatArray:
        """Integral of the relative density over each of these parts, by its value in the middle."""
        part = np.diff(self.nodes)[:, None] / POINTS
        middle = self.nodes[:-1, None] + part * (np.arange(POINTS) + 0.5)
        integral: FloatArray = part * np.interp(middle, self.distance, self.density)
        return integral

    @cached_property
    def _mean(self) -> float:
        return float(self._parts.sum() / (self.limits[1] - self.limits[0]))


@cache
def _precision() -> FloatArray:
    """Return the inverse of the prior covariance of the log factor at the nodes, (K, K).

    The level has none, because the density is normalised; the variance K only makes this regular.
    """
    bends, ends = np.diff(np.eye(NODES), n=2, axis=0), np.eye(NODES)[[0, -1]]
    change = np.subtract(*ends) / (NODES - 1)
    of_shape = bends.T @ bends / BEND**2 + np.outer(change, change) / CHANGE**2
    precision: FloatArray = read_only(of_shape + 1.0 / NODES)
    return precision


@dataclass(frozen=True, eq=False)
class ClutterRanges(Factor):
    """The given density over range, and how often false detections were seen in parts of it.

    The density is the given one with the probability p, and otherwise this times a factor whose
    logarithm is linear between nodes. The logarithms at the nodes have a Gaussian prior by which
    the factor changes smoothly, see `CHANGE` and `BEND`, and the value that is most probable given
    the remembered detections. The likelihood of these depends only on their numbers at the nodes,
    where each counts at both nodes beside it. p follows at even prior odds from the marginal
    likelihoods of both densities, that of the learned one by Laplace's approximation; see
    `loops.most_probable_density`. Where the given density is right, p is soon 1, and nothing is
    lost by learning. The nodes are denser near the radar, where the clutter of the sea and of the
    ground is.

    References
    ----------
    Kooperberg and Stone, "A study of logspline density estimation", Computational Statistics and
    Data Analysis 12(3), 1991; here with linear splines and a prior.
    """

    NAME: ClassVar[str] = "clutter_ranges"
    SIZES: ClassVar[Mapping[str, int]] = {"K": NODES}

    learned: bool  # Whether the law is learned
    configured: GivenDensity
    # Remembered false detections of each node, (K,).
    count: Annotated[FloatArray, floats("K", 0.0, MAX_COUNT)] = zeros_field(NODES)
    # Those of them at which targets were born, by their places among the nodes.
    first: Annotated[FirstDetections, nested(FirstDetections)] = field(
        default_factory=FirstDetections
    )

    @staticmethod
    def of_table(
        learned: bool, limits: tuple[float, float], table: tuple[Sequence[float], Sequence[float]]
    ) -> ClutterRanges:
        """Return the law of a table: ranges and relative densities; empty for a uniform one."""
        distance, density = (np.array(column or [1.0]) for column in table)
        return ClutterRanges(learned, GivenDensity(limits, distance, density))

    def expect(self, view: View) -> View:
        """Return the report with the law."""
        return view.changed(clutter_ranges=self)

    def learn(self, look: Look) -> ClutterRanges:
        """Count the detections that are probably false, without those of local clutter."""
        view, judged = look.view, self.learn_from_others(look)
        if not self.learned or not view.complete or not len(view):
            return judged
        measured = view.detections.measurement
        weight = look.association.false_probability * np.exp(-view.log_clutter_factor(measured))
        distance = view.sensor.visibility.place(measured)[:, 0]
        law, counted = judged.after(distance, weight), weight * _retention(weight)[1]
        return law.changed(first=law.first.with_born(look, self._place(distance), counted))

    def learn_from_others(self, look: Look) -> ClutterRanges:
        """Correct the counts of first detections by what a look shows of their targets."""
        first, change = self.first.judged(look)
        if first is self.first:
            return self
        count = np.clip(self.count + _by_node(first.place, change), 0.0, MAX_COUNT)
        return self.changed(count=count, first=first)

    @property
    def entries(self) -> int:
        """Number of first detections whose targets are still judged."""
        return len(self.first)

    def of_living(self, labels: IntArray) -> ClutterRanges:
        """Return the law with first detections of these targets only, of ascending labels."""
        return self.changed(first=self.first.of(labels))

    def after(self, distance: FloatArray, weight: FloatArray) -> ClutterRanges:
        """Return the law after false detections at these ranges, metres, and with weights, (M,)."""
        added, (retention, scale) = _by_node(self._place(distance), weight), _retention(weight)
        count = retention * self.count + scale * added
        return self.changed(count=count, first=self.first.fading(retention))

    def _place(self, distance: FloatArray) -> FloatArray:
        """Return the places of ranges, metres, among the nodes, (M,)."""
        place: FloatArray = np.interp(distance, self.configured.nodes, np.arange(float(NODES)))
        return place

    @property
    def table(self) -> tuple[FloatArray, FloatArray] | None:
        """Ranges and relative densities of the learned law; None if the given one is likelier.

        Between nodes it has further ranges, because tables are linear there.
        """
        nodes = self.configured.nodes
        distance = np.sort(np.concatenate([nodes, 0.5 * (nodes[1:] + nodes[:-1])]))
        density = self.configured.ratio(distance) * self._change(distance)
        return None if self._learned[0] > EVEN else (distance, density)

    def log_ratio(self, distance: FloatArray) -> FloatArray:
        """Return the log ratio of the density at ranges, metres, to the uniform one, (M,)."""
        ratio = self.configured.ratio(distance)
        if self.learned:
            given = self._learned[0]
            ratio = ratio * (given + (1.0 - given) * self._change(distance))
        return np.log(ratio)

    def _change(self, distance: FloatArray) -> FloatArray:
        """Return the ratio of the learned density to the given one at ranges, metres, (M,)."""
        change: FloatArray = np.exp(np.interp(distance, self.configured.nodes, self._learned[1]))
        return change

    @cached_property
    def _learned(self) -> tuple[float, FloatArray]:
        """Probability of the given density, and the log ratio of the other to it at nodes, (K,)."""
        from ..loops import most_probable_density

        log_odds, log_ratio = most_probable_density(self.count, _precision(), self.configured.share)
        return float(expit(-log_odds)), log_ratio


def _by_node(place: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the sums at each node, (K,), of weights at places, which count at both nodes."""
    below = np.minimum(place.astype(np.int64), NODES - 2)
    above = place - below
    nodes, shares = np.concatenate([below, below + 1]), np.concatenate([1.0 - above, above])
    return sum_by(nodes, np.tile(weight, 2) * shares, NODES)


def _retention(weight: FloatArray) -> tuple[float, float]:
    """Return the factors of the remembered counts, and of those that are added."""
    total = float(weight.sum())
    retention = float(np.exp(-total / MEMORY))
    return retention, (1.0 - retention) * MEMORY / total if total > 0.0 else 1.0
