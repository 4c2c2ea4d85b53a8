"""What goes into an association beside positions, and what it shows beside them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol, TypeAlias, TypeVar

from ..arrays import FloatArray, IntArray
from ..types import Detections

# Number of components whose noise may be learned: the two of a position in the plane, and the range
# rate; one more in space.
COMPONENTS = 3
# Existence probability from which the looks at a target are used for learning.
KNOWN_EXISTENCE = 0.7

# Returns rows, detections and log likelihoods of the pairs in gates, (P,), (P,) and (P, ...).
Gate: TypeAlias = Callable[[Detections], tuple[IntArray, IntArray, FloatArray]]
EvidenceT = TypeVar("EvidenceT", bound="PairEvidence")


class Paired(NamedTuple):
    """Pairs of rows and detections, each detection projected at the height of the row's target."""

    row: IntArray  # Row of each pair, (P,)
    column: IntArray  # Detection of each pair, (P,)
    log_likelihood: FloatArray  # As the gate returns it, (P, ...)
    projected_index: IntArray  # Row of each pair's detection in `projected`, (P,)
    projected: Detections  # The detections, then those projected again at a target's height

    def take(self, pairs: IntArray) -> Paired:
        """Return these pairs alone."""
        return self._replace(
            row=self.row.take(pairs),
            column=self.column.take(pairs),
            log_likelihood=self.log_likelihood.take(pairs, axis=0),
            projected_index=self.projected_index.take(pairs),
        )


def pair_as_reported(gate: Gate, detections: Detections) -> Paired:
    """Return the pairs in the gates of detections that keep their own projection."""
    row, column, log_likelihood = gate(detections)
    return Paired(row, column, log_likelihood, column, detections)


class OutOfGate(NamedTuple):
    """Targets whose identity is shown by a detection outside all of their gates."""

    target: IntArray  # Indices of the engine's targets, (L,)
    column: IntArray  # The detection with the target's identity, (L,)
    since_s: FloatArray  # Time from each target's last detection to this one, seconds, (L,)


class PairEvidence(Protocol):
    """What pairs of rows and detections show besides positions and amplitudes."""

    @property
    def log_factor(self) -> FloatArray:
        """Log factor of each pair's likelihood, (P,)."""

    @property
    def log_clutter(self) -> FloatArray:
        """Log factor of the clutter intensity at each detection, (M,)."""

    @property
    def log_undetected(self) -> FloatArray:
        """Log factor of the intensity of undetected targets at each detection, (M,)."""

    def take(self: EvidenceT, pairs: IntArray) -> EvidenceT:
        """Return the evidence of these pairs alone."""


class NoiseEvidence(NamedTuple):
    """Evidence on the variance of the components of a measurement, and of the range rate, (Z,)."""

    # Effective number of innovations: that number would show the variance equally well if they had
    # no error but the sensor's noise.
    weight: FloatArray
    # Sum of weight times the relative difference of the variance from the sensor's present one; see
    # `gaussian.measurement.noise`.
    excess: FloatArray
    # Mean ratio of variances that the innovations would show at the present variance; larger than 1
    # if outliers are among them.
    expected: FloatArray | float = 1.0
    # The same of all innovations, whichever are outliers; None for a sensor without any.
    with_outliers: NoiseEvidence | None = None


class OutlierEvidence(NamedTuple):
    """Expected numbers among a report's detections of targets."""

    detections: float  # Of known targets
    outliers: float  # Those of them with the larger noise
