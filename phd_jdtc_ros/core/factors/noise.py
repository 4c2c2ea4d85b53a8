"""Measurement noise of a sensor relative to the configured one, learned from innovations.

A change to a larger noise raises an alarm, as a cumulative sum (CUSUM; E. S. Page, "Continuous
inspection schemes", Biometrika 41, 1954) of the log likelihood ratios of the changed and the
learned noise; see also `detection`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from ..arrays import BoolArray, FloatArray, zeros_field
from ..association.evidence import COMPONENTS, NoiseEvidence
from ..sensors.sensor import Sensor
from ..sensors.view import View
from ..snapshot import Snapshot, floats, restored
from .factor import Factor, Look
from .prior import MOST_EVIDENCE, RAISED, RatioPrior

# Weight of the configured variance, as a number of innovations, so that the first innovations do
# not count alone.
PRIOR_WEIGHT = 4.0
# Prior of the ratio of variances.
PRIOR = RatioPrior(0.5, 0.1, 1.4)
# Memory, as a number of innovations of targets whose predicted measurement is certain.
MEMORY = 400.0
# Bounds of the factor of the standard deviation.
LEAST, MOST = 0.25, 4.0
# Bounds of a ratio of variances accepted in a snapshot.
LEAST_FACTOR, MOST_FACTOR = 1e-4, 1e4
# Largest weight, and weight times ratio, accepted in a snapshot; a report may add many innovations
# at once.
MAX_WEIGHT, MAX_RATIO = 1e7, 1e10


@dataclass(frozen=True, eq=False)
class Noise(Factor):
    """Variances of the components of a measurement, and of range rates, relative to the given ones.

    The log of a variance that n innovations show has the precision n / 2; see `RatioPrior`.
    """

    NAME: ClassVar[str] = "noise_factor"
    # Number of innovations after which the noise is compared with the learned one.
    SETTLED: ClassVar[float] = 50.0
    # Change to detect: the ratio of a variance to the learned one.
    NOISIER: ClassVar[float] = 2.0
    # Weight at which the certainty is one half. Outliers are learned after the noise: learned
    # together from the start, a noise twice the configured one is taken for outliers, of which a
    # larger share makes the noise seem small for hundreds of detections.
    CERTAIN_WEIGHT: ClassVar[float] = 20.0

    # Components whose noise is learned, (Z,); the factors of the others are 1.
    learned: BoolArray = field(default_factory=lambda: np.ones(COMPONENTS, dtype=np.bool_))
    # Number of remembered innovations, (Z,).
    weight: Annotated[FloatArray, floats("Z", 0.0, MAX_WEIGHT)] = zeros_field(COMPONENTS)
    # Sum over them of weight times the ratio of variances that each shows, (Z,).
    ratio: Annotated[FloatArray, floats("Z", -MAX_RATIO, MAX_RATIO)] = zeros_field(COMPONENTS)
    # Evidence of a larger noise in each component, (Z,).
    alarm: Annotated[FloatArray, floats("Z", 0.0, MOST_EVIDENCE)] = zeros_field(COMPONENTS)
    # Expected ratio to each configured variance, outliers included, when that evidence began, (Z,);
    # None if there was none yet.
    before: Annotated[FloatArray | None, floats("Z", LEAST_FACTOR, MOST_FACTOR)] = None

    @staticmethod
    def of(learned: BoolArray) -> Noise:
        """Return the factor for these components, before any detection."""
        nothing = np.zeros(len(learned))
        return Noise(learned, nothing, nothing, nothing)

    def restored(self, snapshot: Snapshot, name: str, sensor: Sensor) -> Noise:
        """Return the stored factor; see `Factor.restored`."""
        return restored(self, snapshot, name, {"Z": len(self.learned)})

    def expect(self, view: View) -> View:
        """Return the report whose sensor has the learned noise."""
        sensor = view.sensor
        if self.weight.any():
            sensor = sensor.with_scaled_noise(self.of_std)
        return view.changed(sensor=sensor, noise=self)

    def learn(self, look: Look) -> Noise:
        """Learn from the innovations of a report."""
        evidence = look.association.noise
        if evidence is None or not look.view.complete:
            return self
        return self.with_alarm(evidence).after(evidence)

    @property
    def learns_figures(self) -> bool:
        """Whether `figures` has any, once something was learned."""
        return True

    def figures(self, sensor: Sensor) -> dict[str, float]:
        """Return the ratio of each learned deviation to the configured one, and the alarms."""
        figures: dict[str, float] = {}
        if self.weight.any():
            components = *sensor.components, "range_rate"
            columns = components, self.of_std, self.error, self.learned
            for component, ratio, error, learned in zip(*columns, strict=True):
                if learned:
                    figures[f"{component}_noise_ratio"] = float(ratio)
                    figures[f"{component}_noise_ratio_std"] = float(error)
        noisier = zip((*sensor.components, "range_rate"), self.noisier.tolist(), strict=False)
        return figures | {f"{component}_noisier": 1.0 for component, raised in noisier if raised}

    @property
    def noisier(self) -> BoolArray:
        """Mask of the components whose noise is larger than before, (Z,)."""
        return self.alarm >= RAISED

    @cached_property
    def _factors(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Factors of variances and of deviations, and variances of the logs of the former, (Z,)."""
        shrunk = (PRIOR_WEIGHT + self.ratio) / (PRIOR_WEIGHT + self.weight)
        log_ratio = np.log(np.minimum(np.maximum(shrunk, LEAST**2), MOST**2))
        mean, variance = PRIOR.posterior(log_ratio, 0.5 * self.weight)
        factor = np.exp(mean)
        return factor, np.sqrt(factor), variance

    @property
    def variance(self) -> FloatArray:
        """Factor of each variance, shape (Z,)."""
        return self._factors[0]

    @property
    def of_std(self) -> FloatArray:
        """Factor of each standard deviation, shape (Z,)."""
        return self._factors[1]

    @property
    def certainty(self) -> float:
        """Certainty of the factors of a position's noise, 0 to 1; 1 if they are not learned."""
        weight = self.weight[:-1][self.learned[:-1]].min(initial=np.inf)
        return 1.0 if weight == np.inf else float(weight**2 / (weight**2 + self.CERTAIN_WEIGHT**2))

    @property
    def error(self) -> FloatArray:
        """Standard deviation of `of_std`, shape (Z,)."""
        _, of_std, variance = self._factors
        error: FloatArray = 0.5 * of_std * np.sqrt(variance)
        return error

    def after(self, evidence: NoiseEvidence) -> Noise:
        """Return the factors after the innovations of a further report."""
        retention = np.exp(-evidence.weight / MEMORY)
        ratio = self.variance * (evidence.weight + evidence.excess)
        return self.changed(
            weight=np.where(self.learned, retention * self.weight + evidence.weight, 0.0),
            ratio=np.where(self.learned, retention * self.ratio + ratio, 0.0),
        )

    def with_alarm(self, evidence: NoiseEvidence) -> Noise:
        """Return the factor with the evidence of innovations that are not learned yet.

        Outliers count: after a change, most detections look like outliers.
        """
        evidence = evidence.with_outliers or evidence
        expected = self.variance * evidence.expected
        before = expected
        if self.before is not None:
            # In comparison with the present value, which follows a change immediately, evidence
            # would shrink while it is collected.
            begun = (self.alarm > 0.0) & (self.alarm < RAISED)
            before = np.where(begun, self.before, expected)
        square = (evidence.weight + evidence.excess) * self.variance / before
        ratio = 0.5 * (
            square * (1.0 - 1.0 / self.NOISIER) - evidence.weight * math.log(self.NOISIER)
        )
        ratio = np.where(self.learned & (self.weight >= self.SETTLED), ratio, 0.0)
        alarm = np.minimum(np.maximum(self.alarm + ratio, 0.0), MOST_EVIDENCE)
        return self.changed(alarm=alarm, before=before)
