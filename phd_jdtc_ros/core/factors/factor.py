"""The interface of a factor: one assumption about the world, which weighs associations.

The weight of an association is p_D times the likelihood over the density of false detections, times
one factor for each further thing that is known. A factor is a frozen value with one assumption
about one sensor: what it expects of a report, and what it learns from the association. The
configuration lists the factors of each sensor; one that is not listed costs nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol, TypeVar

import numpy as np

from ..arrays import FloatArray, IntArray, ReadOnly, sum_by
from ..association.claims import Claims
from ..association.evidence import NoiseEvidence, OutlierEvidence, PairEvidence
from ..sensors.sensor import Sensor
from ..sensors.view import View
from ..snapshot import Snapshot, restored, stored_fields, to_snapshot

# Lower bound of the existence probabilities by which others are divided.
LEAST_EXISTENCE = 1e-12

FactorT = TypeVar("FactorT", bound="Factor")


class Targets(Protocol):
    """N hypotheses of T targets before a report."""

    @property
    def label(self) -> IntArray:
        """Label of each target, ascending, (T,)."""

    @property
    def target(self) -> IntArray:
        """Index of each hypothesis's target, (N,)."""

    @property
    def mass(self) -> FloatArray:
        """Weight of each hypothesis, (N,)."""

    @property
    def existence(self) -> FloatArray:
        """Existence probability of each target, (T,)."""

    @property
    def missed(self) -> FloatArray:
        """Probability that each target exists and is not detected, (T,)."""

    @property
    def measured(self) -> FloatArray:
        """Expected measurements of the hypotheses, one for each motion mode, (.., Z)."""

    @property
    def measured_by_target(self) -> FloatArray:
        """Expected measurement of each target, (T, Z); that of any of its likely states."""

    def probability_slower(self, bound: float) -> FloatArray:
        """Return the probability that each hypothesis is slower than a bound in m/s, (N,)."""

    def at_even_odds(self, slower: FloatArray, bound: float) -> FloatArray:
        """Return the probability of being at rest at even prior odds; see `stationary`."""


class Association(Protocol):
    """The association of M detections with the targets, and what it shows of the noise."""

    @property
    def claims(self) -> Claims:
        """Association likelihoods of the P pairs."""

    @property
    def claimed_probability(self) -> FloatArray:
        """Probability that a known target is the source of each detection, (M,)."""

    @property
    def false_probability(self) -> FloatArray:
        """Probability that each detection is false, (M,)."""

    @property
    def pair_probability(self) -> FloatArray:
        """Association probability of each pair, (P,)."""

    @property
    def existence(self) -> FloatArray:
        """Existence probability of each target, (T,)."""

    @property
    def evidence(self) -> PairEvidence | None:
        """What the pairs show besides positions and amplitudes."""

    @property
    def noise(self) -> NoiseEvidence | None:
        """Evidence on the sensor's noise; None if it is known."""

    @property
    def outliers(self) -> OutlierEvidence | None:
        """Evidence on the share of outliers; None for a sensor without any."""


@dataclass(frozen=True)
class Look:
    """What the update with one report shows of its targets."""

    view: View  # As it was used
    expected: View  # As it was before anything was known of its targets, with all detections
    targets: Targets  # Before the report
    association: Association
    born: IntArray  # Labels of the targets born at some of its detections, ascending, (B,)
    born_at: IntArray  # Rows of these detections, (B,)

    @cached_property
    def probability(self) -> FloatArray:
        """Detection probability of each target, if it exists, (T,)."""
        existence = self.targets.existence
        exists = np.where(existence > 0.0, existence, 1.0)
        return 1.0 - self.targets.missed / exists

    @cached_property
    def detected_mass(self) -> FloatArray:
        """Probability that each target exists and was detected, (T,)."""
        found, targets = self.association, self.targets
        row_target = targets.target.take(found.claims.row)
        return sum_by(row_target, found.pair_probability, len(targets.label))

    @cached_property
    def detected(self) -> FloatArray:
        """Probability that each target, and then each newborn one, was detected if it exists."""
        existence = np.maximum(self.association.existence, LEAST_EXISTENCE)
        known = np.minimum(self.detected_mass / existence, 1.0)
        return np.concatenate([known, np.ones(len(self.born))]) if len(self.born) else known

    @property
    def label(self) -> IntArray:
        """Label of each target, and then of each newborn one."""
        label = self.targets.label
        return np.concatenate([label, self.born]) if len(self.born) else label

    @cached_property
    def unclaimed(self) -> FloatArray:
        """Probability that no known target is the source of each detection, (M,)."""
        return 1.0 - self.association.claimed_probability

    def resting(self, bound: float) -> FloatArray:
        """Return the probability that each target is slower than a bound in m/s, (T,).

        It is at even prior odds, given that the target exists.
        """
        targets, size = self.targets, len(self.targets.label)
        slow = sum_by(targets.target, targets.mass * targets.probability_slower(bound), size)
        exists = np.where(targets.existence > 0.0, targets.existence, 1.0)
        return targets.at_even_odds(slow / exists, bound)


@dataclass(frozen=True)
class Factor(ReadOnly):
    """One assumption about a sensor; a subclass overrides what it changes."""

    # Name of its values in snapshots; empty for a factor that learns nothing.
    NAME: ClassVar[str] = ""
    # Sizes of axes in a snapshot, by letter.
    SIZES: ClassVar[Mapping[str, int]] = {}

    def expect(self, view: View) -> View:
        """Return a report with what is expected of it, before anything is known of its targets."""
        return view

    def given(self, view: View, targets: Targets) -> View:
        """Return a report with what is expected of it, given the targets before it."""
        return view

    def learn(self: FactorT, look: Look) -> FactorT:
        """Return the factor after a look of its own sensor."""
        return self

    def learn_from_others(self: FactorT, look: Look) -> FactorT:
        """Return the factor after a look of another sensor."""
        return self

    def figures(self, sensor: Sensor) -> Mapping[str, float]:
        """Return what was learned about a sensor, as it is configured, by name."""
        return {}

    @property
    def learns_figures(self) -> bool:
        """Whether `figures` has any, once something was learned."""
        return False

    @property
    def entries(self) -> int:
        """Number of values that are kept for single targets."""
        return 0

    def of_living(self: FactorT, labels: IntArray) -> FactorT:
        """Return the factor with values of these targets only, of ascending labels."""
        return self

    def continuing(self: FactorT, earlier: FactorT) -> FactorT:
        """Return this configured factor with what an otherwise configured one has learned."""
        return self.changed(**stored_fields(earlier))

    def to_snapshot(self, snapshot: Snapshot, name: str, sensor: Sensor) -> None:
        """Store what was learned under a name."""
        to_snapshot(self, snapshot, name)

    def restored(self: FactorT, snapshot: Snapshot, name: str, sensor: Sensor) -> FactorT:
        """Return this configured factor with what was stored under a name.

        Raises
        ------
        ValueError
            If the values belong to another place, or a tracker could not have stored them.
        """
        return restored(self, snapshot, name, self.SIZES)
