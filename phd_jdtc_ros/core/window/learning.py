"""What the sensors' memory learns from the update with one report."""

from __future__ import annotations

import numpy as np

from ..arrays import sum_by
from ..learned.detection_chains import Look
from ..models.sensor_memory import KNOWN_EXISTENCE, SensorMemory
from ..models.tracker_model import TrackerModel
from ..sensors.report import Report
from .update_steps import Posterior, Prior, RowsT

# Lower bound of the existence probabilities by which others are divided.
LEAST_EXISTENCE = 1e-12


def learn(
    memory: SensorMemory,
    report: Report,
    model: TrackerModel,
    prior: Prior[RowsT],
    posterior: Posterior[RowsT],
) -> Look | None:
    """Learn a sensor's clutter, noise and detection probability from one report.

    Return the report as a look at the prior's targets, whose misses may be correlated; None if
    nothing is learned from it.
    """
    bound = report.sensor.clutter_map_speed
    if memory.learns_clutter(report):
        slower = posterior.claims.share_of(prior.probability_slower(bound))
        stationary = model.detection_births.stationary(slower, bound)
        memory.learn_clutter(report, posterior.claimed_probability, stationary)
    memory.learn_noise(report, posterior.noise, posterior.outliers)
    learns, looks = memory.learns_detections(report), memory.needs_look(report)
    if not learns and not looks:
        return None
    label, measured, existence_after = prior.label, prior.measured_by_target, posterior.existence
    existence_before = prior.existence
    exists = np.where(existence_before > 0.0, existence_before, 1.0)
    probability = 1.0 - prior.missed / exists
    target = prior.target.take(posterior.claims.row)
    # Probability that each target exists and was detected.
    detected = sum_by(target, posterior.pair_probability, len(label))
    if learns:
        clutter = np.zeros(len(existence_before))
        if report.sensor.clutter_map is not None and bound > 0.0:
            # Stationary targets are clutter, which may be detected less often than other targets.
            slow = sum_by(
                prior.target, prior.mass * prior.probability_slower(bound), len(existence_before)
            )
            clutter = model.detection_births.stationary(slow / exists, bound)
        memory.learn_detections(
            report,
            label,
            measured,
            existence_before=existence_before,
            clutter=clutter,
            probability=probability,
            detected=detected,
            existence_after=existence_after,
        )
    if not looks:
        return None
    covered = expected = np.zeros(len(label))
    if memory.correlates_looks(report):
        covered = report.sensor.coverage_probability(measured, report.detections.coverage)
    if report.look_prediction is not None and report.complete:
        expected = report.look_prediction.usual(probability, label)
    return Look(
        label=label,
        covered=covered,
        detected=np.minimum(detected / np.maximum(existence_after, LEAST_EXISTENCE), 1.0),
        expected=expected,
        existence=np.minimum(existence_after, 1.0),
        known=existence_before >= KNOWN_EXISTENCE,
    )
