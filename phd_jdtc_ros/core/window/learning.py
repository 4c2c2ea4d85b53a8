"""What the sensors' memory learns from the update with one report."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray, sum_by
from ..learned.detection_chains import Look
from ..models.sensor_memory import KNOWN_EXISTENCE, SensorMemory
from ..models.tracker_model import TrackerModel
from ..sensors.report import Report
from .update_steps import Posterior, Prior, RowsT, existence_and_missed

# Lower bound of the existence probabilities by which others are divided.
LEAST_EXISTENCE = 1e-12


def learn(
    memory: SensorMemory,
    report: Report,
    model: TrackerModel,
    prior: Prior[RowsT],
    posterior: Posterior[RowsT],
) -> None:
    """Learn a sensor's clutter, noise and detection probability from one report."""
    bound = report.sensor.clutter_map_speed
    if memory.learns_clutter(report):
        slower = posterior.claims.part(prior.probability_slower(bound))
        stationary = model.detection_births.stationary(slower, bound)
        memory.learn_clutter(report, posterior.claimed_probability, stationary)
    if posterior.noise is not None:
        memory.learn_noise(report, posterior.noise)
    if not memory.learns_detections(report):
        return
    before, missed = existence_and_missed(prior)
    exists = np.where(before > 0.0, before, 1.0)
    known = before
    if report.sensor.clutter_map is not None and bound > 0.0:
        # Stationary targets are clutter, which may be detected less often than other targets.
        slow = sum_by(prior.target, prior.mass * prior.probability_slower(bound), len(before))
        known = before * (1.0 - model.detection_births.stationary(slow / exists, bound))
    memory.learn_detections(
        report,
        prior.label,
        prior.measured_by_target,
        before=known,
        probability=1.0 - missed / exists,
        detected=_detected(prior, posterior),
        after=posterior.existence,
    )


def look_at(report: Report, prior: Prior[RowsT], posterior: Posterior[RowsT]) -> Look:
    """Return a report as a look at the prior's targets, whose misses may be correlated."""
    before, missed = existence_and_missed(prior)
    sector, measured = report.detections.coverage, prior.measured_by_target
    expected = np.zeros(len(before))
    if report.look_prediction is not None and report.complete:
        probability = 1.0 - missed / np.where(before > 0.0, before, 1.0)
        expected = report.look_prediction.usual(probability, prior.label)
    after = posterior.existence
    detected = _detected(prior, posterior) / np.maximum(after, LEAST_EXISTENCE)
    return Look(
        label=prior.label,
        covered=report.sensor.coverage_probability(measured, sector),
        detected=np.minimum(detected, 1.0),
        expected=expected,
        existence=np.minimum(after, 1.0),
        known=before >= KNOWN_EXISTENCE,
    )


def _detected(prior: Prior[RowsT], posterior: Posterior[RowsT]) -> FloatArray:
    """Return the probability that each target exists and was detected by a report, (T,)."""
    target = prior.target.take(posterior.claims.row)
    return sum_by(target, posterior.pair_probability, len(prior.label))
