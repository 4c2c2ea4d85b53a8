"""Density of false detections over range: given as a table, learned, or both.

Echoes of the sea and of the ground are dense near a radar and end at its horizon. What differs from
place to place is the clutter map's; a law over range has few numbers and is known after few looks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from scipy.special import expit, gammaln

from ...arrays import FloatArray, zeros_field
from ...sensors.view import View
from ...snapshot import floats
from ..factor import Factor, Look

# Number of nodes of the learned density.
NODES = 12
# Memory of the learned law, as a number of false detections.
MEMORY = 1000.0
# Upper bound accepted in a snapshot: rounding may slightly exceed the memory.
MAX_COUNT = 1.001 * MEMORY
# Probability of the given density from which on it is the likelier one.
EVEN = 0.5
# Points at which the given density is integrated.
POINTS = 2048


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
    def _points(self) -> tuple[FloatArray, FloatArray]:
        """Ranges between the limits and their weights in a mean over range, (POINTS,)."""
        weight = np.full(POINTS, 1.0 / (POINTS - 1))
        weight[[0, -1]] *= 0.5
        return np.linspace(*self.limits, POINTS), weight

    @cached_property
    def _mean(self) -> float:
        points, weight = self._points
        return float(np.interp(points, self.distance, self.density) @ weight)

    @cached_property
    def nodes(self) -> FloatArray:
        """Range of each node, metres, (K,)."""
        near, far = self.limits
        nodes: FloatArray = near + (far - near) * np.linspace(0.0, 1.0, NODES) ** 2
        return nodes

    @cached_property
    def shares(self) -> FloatArray:
        """Share of each node, (K,)."""
        points, weight = self._points
        hats = np.array([np.interp(points, self.nodes, row) for row in np.eye(NODES)])
        shares: FloatArray = hats @ (weight * self.ratio(points))
        return shares


@dataclass(frozen=True, eq=False)
class ClutterRanges(Factor):
    """The given density over range, and how often false detections were seen in parts of it.

    The density is the given one with the probability p, and otherwise this times a factor that is
    linear between nodes. The shares of the nodes have a Dirichlet prior with the mean of the given
    density and the weight of one detection (W. Perks, "Some observations on inverse probability",
    1947), which empty ranges soon outweigh. p follows from the marginal likelihoods of both at even
    prior odds::

        log((1 - p) / p) = log B(s + n) - log B(s) - sum n log s

    with B the multivariate Beta function, s the shares of the given density, and n the remembered
    detections, which count at both nodes beside them. Where the given density is right, p is soon
    1, and nothing is lost by learning. The nodes are denser near the radar, where the clutter of
    the sea and of the ground is.
    """

    NAME: ClassVar[str] = "clutter_ranges"
    SIZES: ClassVar[Mapping[str, int]] = {"K": NODES}

    learned: bool  # Whether the law is learned
    configured: GivenDensity
    # Remembered false detections of each node, (K,).
    count: Annotated[FloatArray, floats("K", 0.0, MAX_COUNT)] = zeros_field(NODES)

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
        view = look.view
        if not self.learned or not view.complete or not len(view):
            return self
        measured = view.detections.measurement
        weight = look.association.false_probability * np.exp(-view.log_clutter_factor(measured))
        return self.after(view.sensor.visibility.place(measured)[:, 0], weight)

    def after(self, distance: FloatArray, weight: FloatArray) -> ClutterRanges:
        """Return the law after false detections at these ranges, metres, and with weights, (M,)."""
        place = np.interp(distance, self.configured.nodes, np.arange(NODES, dtype=np.float64))
        below = np.minimum(place.astype(np.int64), NODES - 2)
        above = place - below
        added = np.bincount(below, weight * (1.0 - above), NODES)
        added += np.bincount(below + 1, weight * above, NODES)
        total = float(added.sum())
        if total == 0.0:
            return self
        retention = float(np.exp(-total / MEMORY))
        scale = (1.0 - retention) * MEMORY / total
        return self.changed(count=retention * self.count + scale * added)

    @property
    def table(self) -> tuple[FloatArray, FloatArray] | None:
        """Ranges and relative densities of the learned law; None if the given one is likelier."""
        given, change = self._learned
        nodes = self.configured.nodes
        return None if given > EVEN else (nodes, change * self.configured.ratio(nodes))

    def log_ratio(self, distance: FloatArray) -> FloatArray:
        """Return the log ratio of the density at ranges, metres, to the uniform one, (M,)."""
        ratio = self.configured.ratio(distance)
        if self.learned:
            given, change = self._learned
            ratio = ratio * (
                given + (1.0 - given) * np.interp(distance, self.configured.nodes, change)
            )
        return np.log(ratio)

    @cached_property
    def _learned(self) -> tuple[float, FloatArray]:
        """Probability of the given density, and the ratio of the other to it at each node, (K,)."""
        share, total = self.configured.shares, float(self.count.sum())
        log_odds = gammaln(share + self.count).sum() - gammaln(share).sum()
        log_odds -= gammaln(1.0 + total) + self.count @ np.log(share)
        return float(expit(-log_odds)), (1.0 + self.count / share) / (1.0 + total)
