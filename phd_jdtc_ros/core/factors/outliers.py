"""Outliers among a sensor's detections of targets: their noise is several times the usual one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

from ..association.evidence import OutlierEvidence
from ..sensors.sensor import Sensor
from ..sensors.view import View
from ..snapshot import floats
from .factor import Factor, Look

# Largest number of remembered detections accepted in a snapshot.
MAX_REMEMBERED = 1e7


@dataclass(frozen=True)
class Outliers(Factor):
    """The noise of a measurement as a mixture of the usual and a larger one, of learned share.

    The defaults describe tails as heavy as those of Student's t distribution with 3 to 5 degrees of
    freedom. The share follows the probabilities that detections were outliers, as in an
    expectation-maximisation algorithm that forgets (Cappé and Moulines, "On-line
    expectation-maximization algorithm for latent data models", Journal of the Royal Statistical
    Society B 71(3), 2009). The ratio is constant: with the learned share, 3 and 5 are as accurate.
    """

    NAME: ClassVar[str] = "outliers"
    # Weight of the share that learning starts from, as a number of detections.
    PRIOR_WEIGHT: ClassVar[float] = 10.0
    # Memory, as a number of detections.
    MEMORY: ClassVar[float] = 400.0
    # Bounds of the share. Without any, no detection would become an outlier again.
    LEAST: ClassVar[float] = 0.005
    MOST: ClassVar[float] = 0.5

    start: float = 0.05  # Share that learning starts from
    ratio: float = 3.0  # Standard deviations of outliers relative to the usual ones
    detections: Annotated[float, floats("", 0.0, MAX_REMEMBERED)] = 0.0  # Remembered
    outliers: Annotated[float, floats("", 0.0, MAX_REMEMBERED)] = 0.0  # Remembered

    def expect(self, view: View) -> View:
        """Return the report whose sensor has outliers among its measurements."""
        return view.changed(sensor=view.sensor.changed(outliers=self))

    def learn(self, look: Look) -> Outliers:
        """Learn the share from the innovations of a report."""
        evidence = look.association.outliers
        return self.after(evidence) if evidence is not None and look.view.complete else self

    @property
    def learns_figures(self) -> bool:
        """Whether `figures` has any, once something was learned."""
        return True

    def figures(self, sensor: Sensor) -> dict[str, float]:
        """Return the share and its standard deviation."""
        if not self.detections:
            return {}
        return {"outlier_share": self.share, "outlier_share_std": self.std}

    @cached_property
    def share(self) -> float:
        """Probability that a detection of a target is an outlier."""
        share = (self.PRIOR_WEIGHT * self.start + self.outliers) / (
            self.PRIOR_WEIGHT + self.detections
        )
        return min(max(share, self.LEAST), self.MOST)

    @property
    def std(self) -> float:
        """Standard deviation of `share`."""
        return math.sqrt(self.share * (1.0 - self.share) / (self.PRIOR_WEIGHT + self.detections))

    def after(self, evidence: OutlierEvidence) -> Outliers:
        """Return the outliers after the detections of a further report."""
        retention = math.exp(-evidence.detections / self.MEMORY)
        return self.changed(
            detections=retention * self.detections + evidence.detections,
            outliers=retention * self.outliers + evidence.outliers,
        )
