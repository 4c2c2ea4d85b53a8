"""Outliers among a sensor's detections of targets: their noise is several times the usual one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

from ..arrays import ReadOnly
from ..snapshot import floats

# Weight of the share that learning starts from, as a number of detections.
PRIOR_WEIGHT = 10.0
# Memory, as a number of detections.
MEMORY = 400.0
# Bounds of the share. Without any, no detection would become an outlier again.
LEAST, MOST = 0.005, 0.5
# Largest number of remembered detections accepted in a snapshot.
MAX_REMEMBERED = 1e7


class OutlierEvidence(NamedTuple):
    """Expected numbers among a report's detections of targets."""

    detections: float  # Of known targets
    outliers: float  # Those of them with the larger noise


@dataclass(frozen=True)
class Outliers(ReadOnly):
    """The noise of a measurement as a mixture of the usual and a larger one, of learned share.

    The defaults describe tails as heavy as those of Student's t distribution with 3 to 5 degrees of
    freedom. The share follows the probabilities that detections were outliers, as in an
    expectation-maximisation algorithm that forgets (Cappé and Moulines, "On-line
    expectation-maximization algorithm for latent data models", Journal of the Royal Statistical
    Society B 71(3), 2009). The ratio is constant: with the learned share, 3 and 5 are as accurate.
    """

    start: float = 0.05  # Share that learning starts from
    ratio: float = 3.0  # Standard deviations of outliers relative to the usual ones
    detections: Annotated[float, floats("", 0.0, MAX_REMEMBERED)] = 0.0  # Remembered
    outliers: Annotated[float, floats("", 0.0, MAX_REMEMBERED)] = 0.0  # Remembered

    @cached_property
    def share(self) -> float:
        """Probability that a detection of a target is an outlier."""
        share = (PRIOR_WEIGHT * self.start + self.outliers) / (PRIOR_WEIGHT + self.detections)
        return min(max(share, LEAST), MOST)

    @property
    def std(self) -> float:
        """Standard deviation of `share`."""
        return math.sqrt(self.share * (1.0 - self.share) / (PRIOR_WEIGHT + self.detections))

    def after(self, evidence: OutlierEvidence) -> Outliers:
        """Return the outliers after the detections of a further report."""
        retention = math.exp(-evidence.detections / MEMORY)
        return self.changed(
            detections=retention * self.detections + evidence.detections,
            outliers=retention * self.outliers + evidence.outliers,
        )
