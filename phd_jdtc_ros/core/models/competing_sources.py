"""Sources of detections that compete with the known targets: clutter and undetected targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from ..association.evidence import PairEvidence
from ..sensors.view import View
from .detection_birth import EarlierLooks, Newborn
from .tracker_model import TrackerModel


@dataclass(frozen=True)
class CompetingSources:
    """The intensity of clutter and of undetected targets at each detection."""

    # Log of the common divisor of the intensities and of the known targets' likelihoods, which is
    # their maximum, (M,). Without it the clutter density underflows above an amplitude of 38.
    log_scale: FloatArray
    # Intensities of clutter and of undetected targets by class, (1 + C, M); (1, M) without births
    # at detections.
    intensity: FloatArray

    @property
    def total(self) -> FloatArray:
        """Sum of the intensities, shape (M,)."""
        total: FloatArray = self.intensity.sum(axis=0)
        return total

    @property
    def false_share(self) -> FloatArray:
        """Share of clutter in the sum, shape (M,)."""
        total = self.total
        share: FloatArray = self.intensity[0] / np.where(total > 0.0, total, 1.0)
        return share

    def newborn(self, claimed: FloatArray, report: View, least_mass: float) -> Newborn:
        """Return the probabilities that unclaimed detections are undetected targets.

        `claimed` has the probability that a known target is the source of each detection, (M,).
        Detections with a smaller newborn mass than `least_mass` are left out.
        """
        total = self.total
        unknown = (1.0 - claimed) * self.intensity[1:] / np.where(total > 0.0, total, 1.0)
        mass = unknown.T
        rows = (mass.sum(axis=1) >= least_mass).nonzero()[0]
        return Newborn(report if len(rows) == len(mass) else report.take(rows), mass[rows], rows)


def log_intensities(
    report: View,
    model: TrackerModel,
    dt: float,
    earlier: Sequence[Newborn] = (),
    evidence: PairEvidence | None = None,
    looks: EarlierLooks | None = None,
) -> FloatArray:
    """Return the log intensities of the other sources of a report's detections, (1 + C, M).

    `dt` are the seconds since the previous scan; `earlier` has the targets born at the detections
    of the scan's earlier reports, and `looks` the reports of earlier scans. The detections'
    identities and heights multiply both intensities.
    """
    log_clutter = 0.0 if evidence is None else evidence.log_clutter
    log_other: FloatArray = report.log_clutter[None] + log_clutter
    if model.detection_births.enabled:
        births = model.detection_births
        log_birth = births.log_intensity(report, model.modes, dt, earlier, looks)
        log_undetected = 0.0 if evidence is None else evidence.log_undetected
        log_other = np.concatenate([log_other, log_birth + log_undetected])
    return log_other
