"""The update of particles (Sec. IV-C, Step 2): a report's detections correct the intensity.

The posterior stays split into a Poisson part and Bernoulli components (see `ParticleSet`), because
the smoother needs the split.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from ..arrays import TINY, FloatArray, IntArray, factorize, sum_by
from ..association.claims import Claims
from ..attributes.evidence import Evidence
from ..attributes.reprojection import Paired
from ..attributes.uniqueness import OutOfGate
from ..learned.noise_factor import NoiseEvidence
from ..models import detection_birth, newborn_sampling
from ..models.competing_sources import competing_sources
from ..models.detection_birth import Newborn
from ..models.tracker_model import TrackerModel
from ..sensors.report import LEAST_UNSEEN, Report
from ..types import Coverage, Detections
from ..window.update_steps import Posterior
from .correction import Corrector
from .noise import noise_evidence
from .particle_set import ParticleSet
from .reacquisition import with_reacquired


@dataclass(frozen=True)
class ParticleSteps:
    """The steps of an update of particles; see `window.update_steps.UpdateSteps`."""

    model: TrackerModel
    corrector: Corrector
    rng: np.random.Generator

    def prior(self, rows: ParticleSet, report: Report) -> PriorParticles:
        """Return the particles as the prior of a report's update."""
        return PriorParticles(rows, report, self)

    def with_newborn(
        self, rows: ParticleSet, newborn: Newborn, label: int
    ) -> tuple[ParticleSet, Newborn]:
        """Return the intensity with as many newborn targets as it may have, and these targets."""
        model, rng = self.model, self.rng
        newborn, particles = detection_birth.limit_newborns(newborn, model.detection_births)
        state, mode, weight, detection = newborn_sampling.sample(newborn, model, particles, rng)
        count, births = len(weight), len(newborn)
        amplitude = newborn.report.detections.amplitude
        amplitude = None if amplitude is None else amplitude.take(detection)
        log_snr = model.amplitudes.draw(mode, model.modes, rng, amplitude)
        component_label = (
            label + np.arange(births) if self.corrector.labelled else np.full(births, -1)
        )
        added = ParticleSet(
            state=state,
            mode=mode,
            row_label=label + detection,
            parent=np.full(count, -1),
            multiplicity=np.ones(count, dtype=np.int64),
            poisson=np.zeros(count),
            components=sparse.csr_array(
                (weight, detection, np.arange(count + 1)), shape=(count, births)
            ),
            label=component_label,
            log_snr=log_snr,
        )
        return ParticleSet.concatenate([rows, added]), newborn


@dataclass(frozen=True)
class PriorParticles:
    """Particles before a report; see `window.update_steps.Prior`."""

    particles: ParticleSet
    report: Report
    steps: ParticleSteps

    @cached_property
    def _targets(self) -> tuple[IntArray, IntArray]:
        return factorize(self.particles.row_label)

    @property
    def label(self) -> IntArray:
        """Label of each target, shape (T,)."""
        return self._targets[0]

    @property
    def target(self) -> IntArray:
        """Index of each particle's target, shape (N,)."""
        return self._targets[1]

    @property
    def mass(self) -> FloatArray:
        """Weight of each particle, shape (N,)."""
        return self.particles.weight

    @property
    def existence(self) -> FloatArray:
        """Existence probability of each target, shape (T,)."""
        return sum_by(self.target, self.mass, len(self.label))

    @property
    def missed(self) -> FloatArray:
        """Probability that each target exists and is not detected, shape (T,)."""
        return sum_by(self.target, self.mass * (1.0 - self.detection_probability), len(self.label))

    @cached_property
    def _all_measured(self) -> FloatArray:
        """Measurements of all particles, including those beyond the sensor's range, (N, Z)."""
        return self.report.sensor.measure(self.particles.state)

    @cached_property
    def measured(self) -> FloatArray:
        """Measurements of the particles within the sensor's range, shape (N, Z)."""
        return self.report.sensor.reachable(self._all_measured)

    @property
    def measured_by_target(self) -> FloatArray:
        """Measurement of each target's first particle, shape (T, Z)."""
        return self.measured[np.unique(self.target, return_index=True)[1]]

    @property
    def detection_probability(self) -> FloatArray:
        """Probability that each particle is detected, shape (N,)."""
        return self._seen[0]

    @cached_property
    def _in_turn(self) -> FloatArray:
        """Probability that each particle is detected in a whole turn, shape (N,)."""
        covered = (
            self.report.sensor.coverage_probability(self._all_measured, None) * self.report.share
        )
        prediction = self.report.informative_prediction
        if prediction is None:
            return covered * self._usual
        return covered * prediction.probability(self._usual, self.particles.row_label)

    @cached_property
    def _usual(self) -> FloatArray:
        """Detection probability of each covered particle, regardless of the last look, (N,)."""
        report, model, particles = self.report, self.steps.model, self.particles
        probability = report.sensor.configured_detection_probability(self._all_measured)
        if probability is None:
            probability = model.amplitudes.detection_probability(
                particles.mode, particles.log_snr, report.sensor, model.modes
            )
        return report.sensor.learned_detection_probability(probability, self._all_measured)

    def _mean(self, values: FloatArray) -> FloatArray:
        """Return the mean of each target's values, (N,) to (T,)."""
        mass = sum_by(self.target, self.particles.weight, len(self.label))
        total = sum_by(self.target, self.particles.weight * values, len(self.label))
        mean: FloatArray = total / np.where(mass > 0.0, mass, 1.0)
        return mean

    def _measured_in(self, sector: Coverage) -> FloatArray:
        """Return the probability that each particle is measured in a sector, (N,)."""
        return self.report.sensor.sector_probability(self._all_measured, sector)

    @property
    def _unseen(self) -> FloatArray | None:
        """Factor of the earlier sectors, shape (N,); see `Report.detection_probability`."""
        return self._seen[1]

    @cached_property
    def _seen(self) -> tuple[FloatArray, FloatArray | None]:
        label = self.particles.row_label
        return self.report.detection_probability(label, self._in_turn, self._measured_in)

    def gate(self, detections: Detections) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the gated pairs, with the log likelihoods of the measurements."""
        sensor, times = self.report.sensor, detections.time_s
        rate = None if times is None else sensor.measurement_rate(self.particles.state)
        return sensor.gated_pairs(self.measured, detections, rate)

    def probability_slower(self, bound: float) -> FloatArray:
        """Return 1 for each particle slower than a bound in m/s, 0 otherwise, shape (N,)."""
        velocity = self.particles.state[:, list(self.steps.model.modes.space.velocity)]
        return (np.hypot(velocity[:, 0], velocity[:, 1]) < bound).astype(np.float64)

    def with_reacquired(self, out_of_gate: OutOfGate) -> PriorParticles:
        """Return the prior with additional particles; see `reacquisition.with_reacquired`."""
        steps = self.steps
        particles = with_reacquired(
            self.particles, out_of_gate, self.report, steps.model, steps.rng
        )
        return replace(self, particles=particles)

    def posterior(
        self, pairs: Paired, evidence: Evidence | None, log_other: FloatArray
    ) -> Posterior[ParticleSet]:
        """Return the intensity that the corrector computes from the pairs."""
        report, model, particles = self.report, self.steps.model, self.particles
        row, column = pairs.row, pairs.column
        log_likelihood = pairs.log_likelihood + report.sensor.log_range_rate(
            particles.state, report.detections, (row, column)
        )
        log_likelihood += model.amplitudes.log_likelihood(
            particles.mode, particles.log_snr, report, (row, column), model.modes
        )
        if evidence is not None:
            log_likelihood += evidence.log_factor
        if self._unseen is not None:
            # The mean of each target is used: with a factor for each particle, the few particles
            # that the miss has left in the earlier sectors would gain weight.
            mean = self._mean(self._unseen)
            log_likelihood += np.log(np.maximum(mean, LEAST_UNSEEN)).take(self.target.take(row))
        if report.informative_prediction is not None:
            usual = self._usual
            after_look = report.informative_prediction.probability(usual, particles.row_label)
            ratio = self._mean(after_look) / np.maximum(self._mean(usual), TINY)
            log_likelihood += np.log(np.maximum(ratio, TINY)).take(self.target.take(row))
        sources = competing_sources(log_other, column, log_likelihood)
        scaled = np.exp(log_likelihood - sources.log_scale.take(column))
        claims = Claims(
            row=row,
            column=column,
            mass=particles.weight.take(row) * scaled,
            other=sources.total,
            detection_probability=self.detection_probability,
        )
        corrected = self.steps.corrector.correct(particles, claims)
        return Posterior(
            rows=corrected.particles,
            claims=claims,
            sources=sources,
            claimed_probability=corrected.claimed,
            pair_probability=corrected.pair,
            existence=sum_by(self.target, corrected.particles.weight, len(self.label)),
            evidence=evidence,
            noise=self._noise_evidence(pairs, corrected.pair),
        )

    def _noise_evidence(self, pairs: Paired, probability: FloatArray) -> NoiseEvidence | None:
        """Return the evidence of the pairs on the noise; None if the noise is known."""
        report = self.report
        if report.sensor.noise_factor is None or not self.steps.corrector.labelled:
            return None
        readings = report.project_as(pairs.projected)
        indices = pairs.row, pairs.projected_index
        rows = self.target, self.mass, self.particles.state, self._all_measured
        return noise_evidence(readings, *rows, indices, probability)
