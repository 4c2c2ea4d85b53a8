"""An engine's part of an update, which `update` calls report by report.

It gives the expected measurements of its rows, the gated pairs of rows and detections, and the rows
after an association.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from ..arrays import FloatArray, IntArray
from ..association.claims import Claims
from ..attributes.evidence import Evidence
from ..attributes.reprojection import Paired
from ..attributes.uniqueness import OutOfGate
from ..learned.noise_factor import NoiseEvidence
from ..learned.outliers import OutlierEvidence
from ..models.competing_sources import CompetingSources
from ..models.detection_birth import Newborn
from ..models.tracker_model import TrackerModel
from ..sensors.report import Report
from ..types import Detections

RowsT = TypeVar("RowsT")


@dataclass(frozen=True)
class Posterior(Generic[RowsT]):
    """Rows after one report, and the association that led to them."""

    rows: RowsT
    claims: Claims  # Association likelihoods of the P pairs
    sources: CompetingSources  # Sources of the detections other than these targets
    # Probability that a known target is the source of each detection, (M,).
    claimed_probability: FloatArray
    pair_probability: FloatArray  # Association probability of each pair, (P,)
    existence: FloatArray  # Existence probability of each target, (T,)
    evidence: Evidence | None  # Identities and heights as evidence for these pairs
    noise: NoiseEvidence | None = None  # Evidence on the sensor's noise; None if its noise is known
    outliers: OutlierEvidence | None = None  # Evidence on their share; None without any
    # Number of clusters of targets too large for exact association probabilities.
    approximate: int = 0


class Prior(Protocol[RowsT]):
    """N rows of T targets before one report."""

    @property
    def label(self) -> IntArray:
        """Label of each target, ascending, (T,)."""

    @property
    def target(self) -> IntArray:
        """Index of each row's target, (N,)."""

    @property
    def mass(self) -> FloatArray:
        """Weight of each row, (N,)."""

    @property
    def existence(self) -> FloatArray:
        """Existence probability of each target, (T,)."""

    @property
    def missed(self) -> FloatArray:
        """Probability that each target exists and is not detected, (T,)."""

    @property
    def measured(self) -> FloatArray:
        """Expected measurements of the rows, (N, Z)."""

    @property
    def measured_by_target(self) -> FloatArray:
        """Expected measurement of each target, (T, Z); that of any of its likely states."""

    def gate(self, detections: Detections) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the gated pairs of rows and detections, with their log likelihoods."""

    def with_reacquired(self, out_of_gate: OutOfGate) -> Prior[RowsT]:
        """Return the prior with additional rows at the detections of targets out of their gates."""

    def probability_slower(self, bound: float) -> FloatArray:
        """Return the probability that each row is slower than a bound in m/s, (N,)."""

    def posterior(
        self, pairs: Paired, evidence: Evidence | None, log_other: FloatArray
    ) -> Posterior[RowsT]:
        """Return the rows after the association of the detections.

        Parameters
        ----------
        evidence : Evidence or None
            Identities and heights as evidence for these pairs.
        log_other : array of shape (1 + C, M)
            See `competing_sources.log_intensities`.
        """


class UpdateSteps(Protocol[RowsT]):
    """An engine's part of an update."""

    @property
    def model(self) -> TrackerModel:
        """Assumptions about targets and sensors."""

    def prior(self, rows: RowsT, report: Report) -> Prior[RowsT]:
        """Return the rows as the prior of a report's update."""

    def with_newborn(self, rows: RowsT, newborn: Newborn, label: int) -> tuple[RowsT, Newborn]:
        """Return the rows with the targets born at detections, numbered from `label`, and these."""
