"""The update of Gaussians: every detection in a hypothesis's gate makes a new hypothesis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import TINY, FloatArray, IntArray, frozen
from ..association.claims import Claims
from ..association.evidence import NoiseEvidence, OutlierEvidence, OutOfGate, Paired, PairEvidence
from ..models.competing_sources import CompetingSources
from ..models.detection_birth import Newborn
from ..models.tracker_model import TrackerModel
from ..sensors.of_gaussians.linearised import Expected
from ..sensors.view import View
from ..types import Coverage, Detections
from .bounds import Bounds
from .dynamics import Dynamics
from .measurement.amplitude import (
    Amplitudes,
    DetectionProbability,
    detection_probability,
    slower,
    snr_after,
)
from .measurement.heights import above_floor, without_unlikely
from .measurement.iterated_update import PairUpdate, coarse_further, iterated_update
from .measurement.likely_pairs import select_likely
from .measurement.missed import after_miss, missed_and_measured
from .measurement.newborn import newborn_mixture
from .measurement.noise import evidence_of_pairs
from .measurement.pair_association import Association, associate
from .measurement.pairs import PairLikelihoods, sum_modes
from .mixture import Mixture
from .reacquisition import with_reacquired
from .reduction import Branched

# A hypothesis with a smaller probability of detection is outside the coverage.
UNSEEN = 0.05


@dataclass(frozen=True)
class Posterior:
    """Hypotheses after one report, and the association that led to them."""

    rows: Branched
    claims: Claims  # Association likelihoods of the P pairs
    sources: CompetingSources  # Sources of the detections other than these targets
    # Probability that a known target is the source of each detection, (M,).
    claimed_probability: FloatArray
    # Probability that each is false, (M,). New targets count as false if there are amplitudes:
    # while the law of these is wrong, every false detection of a new kind looks like a target and
    # would never be learned.
    false_probability: FloatArray
    pair_probability: FloatArray  # Association probability of each pair, (P,)
    existence: FloatArray  # Existence probability of each target, (T,)
    evidence: PairEvidence | None  # Identities and heights as evidence for these pairs
    noise: NoiseEvidence | None = None  # Evidence on the sensor's noise; None if its noise is known
    outliers: OutlierEvidence | None = None  # Evidence on their share; None without any
    # Number of clusters of targets too large for exact association probabilities.
    approximate: int = 0

    def newborns(self, view: View, model: TrackerModel, least_mass: float) -> tuple[Newborn, ...]:
        """Return the targets born at the report's detections; none without births there."""
        if not model.detection_births.enabled:
            return ()
        return (self.sources.newborn(self.claimed_probability, view, least_mass),)


@dataclass(frozen=True)
class GaussianSteps:
    """The steps of an update with one report: before it, after it, and the targets born at it."""

    dynamics: Dynamics
    bounds: Bounds

    @property
    def model(self) -> TrackerModel:
        """Assumptions about targets and sensors."""
        return self.dynamics.model

    def prior(self, rows: Branched, report: View) -> PriorMixture:
        """Return the hypotheses as the prior of a report's update."""
        mixture, sensor = rows.mixture, report.sensor
        expected = sensor.of_gaussians.expected(mixture.mean, mixture.covariance)
        prediction = report.informative_prediction
        looked = None if prediction is None else prediction.of(mixture.row_label)
        probability = detection_probability(expected, mixture.snr, report, self.dynamics, looked)
        by_class, (count, modes, size) = probability.by_class, expected.measured.shape
        places = expected.measured.reshape(-1, size), expected.std.reshape(-1, size)

        def measured_in(sector: Coverage) -> FloatArray:
            share = sensor.visibility.probability_in_sector(
                places[0], sector, sensor.noise_std, places[1]
            )
            return share.reshape(count, modes, 1)

        in_revolution = by_class if report.share == 1.0 else report.share * by_class
        seen = report.detection_probability(mixture.row_label, in_revolution, measured_in)
        return PriorMixture(mixture, rows.parent, expected, report, self, probability, *seen)

    def with_newborns(
        self, rows: Branched, newborns: tuple[Newborn, ...], label: int
    ) -> tuple[Branched, IntArray, IntArray]:
        """Return the hypotheses with those of targets born at detections, numbered from `label`.

        The further results are the labels of these targets, and the rows of their detections.
        """
        if not newborns or not len(newborns[0]):
            none = np.zeros(0, dtype=np.int64)
            return rows, none, none
        (newborn,) = newborns
        added = newborn_mixture(newborn, self.dynamics, label)
        parent = np.concatenate([rows.parent, np.full(len(added), -1)])
        joined = Branched(Mixture.concatenate([rows.mixture, added]), parent)
        return joined, label + np.arange(len(newborn)), newborn.row


@dataclass(frozen=True)
class PriorMixture:
    """Hypotheses before a report."""

    mixture: Mixture
    parent: IntArray  # See `Branched`
    expected: Expected  # Measurements expected of the Gaussians
    report: View
    steps: GaussianSteps
    probability: DetectionProbability  # In a whole revolution
    detection_probability: FloatArray  # Probability that each Gaussian is detected, (H, R, C)
    # Factor of the earlier sectors, (H, R, C); see `View.detection_probability`.
    unseen: FloatArray | None

    @property
    def label(self) -> IntArray:
        """Label of each target, shape (T,)."""
        return self.mixture.sums.label

    @property
    def target(self) -> IntArray:
        """Index of each hypothesis's target, shape (H,)."""
        return self.mixture.sums.target

    @property
    def mass(self) -> FloatArray:
        """Weight of each hypothesis, shape (H,)."""
        return self.mixture.sums.mass

    @property
    def existence(self) -> FloatArray:
        """Existence probability of each target, shape (T,)."""
        return self.mixture.sums.existence

    @property
    def missed(self) -> FloatArray:
        """Probability that each target exists and is not detected, shape (T,)."""
        return self._by_target[0]

    @property
    def measured(self) -> FloatArray:
        """Measurements expected of the Gaussians, shape (H R, Z)."""
        return self.expected.measured.reshape(-1, self.expected.measured.shape[-1])

    @property
    def measured_by_target(self) -> FloatArray:
        """Expected measurement of each target's first hypothesis, shape (T, Z)."""
        return self._by_target[1]

    @cached_property
    def _by_target(self) -> tuple[FloatArray, FloatArray]:
        hypotheses, measured = self.mixture.hypotheses, self.expected.measured
        return missed_and_measured(hypotheses, self.detection_probability, measured)

    def _average(self, by_class: FloatArray) -> FloatArray:
        """Return the mean of each hypothesis's values, (H, R, C) to (H,)."""
        return sum_modes(self.mixture.weight * by_class) / np.maximum(self.mass, TINY)

    def gate(self, detections: Detections) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pairs of a hypothesis and a detection in the gate of one of its Gaussians.

        Returns
        -------
        row, column : int arrays of shape (P,)
        log_likelihood : array of shape (P, R)
            Log likelihood with the measurement linearised at the mean; -inf outside a Gaussian's
            gate. The noise is that of outliers if the sensor has any.
        """
        mixture, report = self.mixture, self.report.project_as(detections)
        weight, gaussians = mixture.sums.mode_weight, report.sensor.of_gaussians
        return gaussians.gate_pairs(weight, mixture.mean, self.expected, report)

    def probability_slower(self, bound: float) -> FloatArray:
        """Return the probability that each hypothesis is slower than a bound in m/s, (H,)."""
        return slower(self.mixture, bound, self.steps.model.modes.space)

    def at_even_odds(self, slower: FloatArray, bound: float) -> FloatArray:
        """Return the probability of being at rest; see `DetectionBirthModel.stationary`."""
        return self.steps.model.detection_births.stationary(slower, bound)

    def with_reacquired(self, out_of_gate: OutOfGate) -> PriorMixture:
        """Return the prior with hypotheses of lost targets; see `reacquisition.with_reacquired`."""
        rows = Branched(self.mixture, self.parent)
        return self.steps.prior(with_reacquired(rows, out_of_gate, self.steps.model), self.report)

    def posterior(
        self, pairs: Paired, evidence: PairEvidence | None, log_other: FloatArray
    ) -> Posterior:
        """Return the updated hypotheses: one without a detection, and one for each in the gate.

        Only the most probable hypotheses of each target are kept.

        Parameters
        ----------
        evidence : PairEvidence or None
            Identities and heights as evidence for these pairs.
        log_other : array of shape (1 + C, M)
            See `competing_sources.log_intensities`.

        Notes
        -----
        Let psi(z) be the sum of weight times likelihood of detection z over all Gaussians of a
        target, and p(z) and p(0) the marginal probabilities that the target has detection z or
        none. The weight of a hypothesis with z is its prior weight times its likelihood, times
        p(z) / psi(z).
        """
        readings = self.report.project_as(pairs.projected)
        amplitudes = Amplitudes.of(self.report, self.steps.dynamics)
        coarse = self._coarse_log_likelihood(pairs, readings)
        factor = self._log_factor(pairs, evidence)
        gated = frozen(
            PairLikelihoods(pairs.row, pairs.column, coarse, amplitudes.largest, factor, log_other)
        )
        kept, amplitude = select_likely(self.mixture, self.detection_probability, gated, amplitudes)
        if len(kept) < len(factor):
            pairs, factor = pairs.take(kept), factor.take(kept)
            evidence = None if evidence is None else evidence.take(kept)

        update = iterated_update(self.mixture, pairs.row, pairs.projected_index, readings)
        exact = update.log_likelihood.reshape(-1, self.mixture.mean.shape[1])
        likelihoods = frozen(
            PairLikelihoods(pairs.row, pairs.column, exact, amplitudes.largest, factor, log_other)
        )
        association = associate(
            self.mixture, self.detection_probability, amplitude, likelihoods, self.steps.bounds
        )
        noise, outliers = evidence_of_pairs(self.mixture, update, association.pair)
        false = 1.0 - association.claimed
        if self.report.detections.amplitude is None:
            false = false * association.sources.false_share
        return Posterior(
            rows=self._branch(association, update, amplitudes),
            claims=association.claims,
            sources=association.sources,
            claimed_probability=association.claimed,
            false_probability=false,
            pair_probability=association.pair,
            existence=association.existence,
            evidence=evidence,
            noise=noise,
            outliers=outliers,
            approximate=association.approximate,
        )

    def _coarse_log_likelihood(self, pairs: Paired, readings: View) -> FloatArray:
        """Return the log likelihoods of pairs, linearised at the predicted means, (P, R)."""
        further = coarse_further(self.mixture, pairs.row, pairs.projected_index, readings)
        return pairs.log_likelihood if further is None else pairs.log_likelihood + further

    def _log_factor(self, pairs: Paired, evidence: PairEvidence | None) -> FloatArray:
        """Return the log likelihoods of pairs besides measurement and amplitude, (P,)."""
        factor = np.zeros(len(pairs.row)) if evidence is None else evidence.log_factor
        if self.unseen is not None:
            mean = self._average(self.unseen)
            factor = factor + np.log(np.maximum(mean, TINY)).take(pairs.row)
        if self.report.look_prediction is not None:
            probability = self._average(self.probability.by_class)
            usual = self.expected, self.mixture.snr, self.report, self.steps.dynamics
            unconditional = self._average(detection_probability(*usual).by_class)
            ratio = np.maximum(probability / np.maximum(unconditional, TINY), TINY)
            factor = factor + np.log(ratio).take(pairs.row)
        return factor

    def _branch(
        self, association: Association, update: PairUpdate, amplitudes: Amplitudes
    ) -> Branched:
        """Return the kept hypotheses: those without a detection, and those of the pairs.

        Only the Gaussians of kept hypotheses are updated.
        """
        mixture, prior_row, pair = self.mixture, association.prior_row, association.kept_pair
        gaussians = update.updated_gaussians(mixture, prior_row, pair)
        after_misses = after_miss(
            mixture, self.expected, self.report.sensor, self.detection_probability
        )
        if after_misses is not None:
            missed = pair < 0
            for updated, after in zip(gaussians, after_misses, strict=True):
                updated[missed] = after[prior_row[missed]]
        snr = snr_after(
            mixture.hypotheses,
            self.detection_probability,
            self.probability,
            amplitudes,
            prior_row,
            pair,
            association.claims.column,
        )
        mean, covariance = gaussians
        branched = mixture.changed(
            row_label=mixture.row_label.take(prior_row),
            weight=association.weight,
            mean=mean,
            covariance=covariance,
            snr=snr,
        )
        model = self.steps.model
        if model.floor > -np.inf:
            branched = above_floor(branched, model.floor)
        elif model.height_prior is not None:
            outside = (pair < 0) & (self.detection_probability[prior_row] < UNSEEN).all(axis=(1, 2))
            branched = without_unlikely(branched, outside, model.height_prior)
        return Branched(branched, self.parent.take(prior_row))
