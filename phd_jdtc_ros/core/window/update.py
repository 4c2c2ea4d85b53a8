"""The update of a set of rows with the reports of a scan, common to all engines.

Each report corrects the rows in turn. An engine implements the steps; see `update_steps`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by
from ..association.claims import undetected
from ..attributes.evidence import Evidence
from ..attributes.memory import AttributeMemory, AttributesAt
from ..attributes.reprojection import Paired, plain
from ..attributes.uniqueness import OutOfGate
from ..learned.detection_chains import Look
from ..models import detection_limit
from ..models.clutter_learning import ClutterMemory
from ..models.competing_sources import log_intensities
from ..models.detection_birth import Newborn
from ..models.sensor_learning import SensorMemory, look_at
from ..models.tracker_model import TrackerModel
from ..sensors.report import Report
from ..tracks import labels
from ..types import Scan
from .antenna_pass import AntennaPasses
from .update_steps import Posterior, Prior, RowsT, UpdateSteps

# Lower bound of the existence probabilities by which others are divided.
LEAST_EXISTENCE = 1e-12


@dataclass(frozen=True)
class UpdatedScan(Generic[RowsT]):
    """Rows after the reports of a scan."""

    rows: RowsT
    newborns: tuple[Newborn, ...]  # By report; empty if births at detections are disabled
    approximate: int  # Number of clusters of targets too large for exact association probabilities


@dataclass(frozen=True)
class Updated(UpdatedScan[RowsT]):
    """Rows after one report."""

    label: IntArray  # Label of each target before the report, ascending, (T,)
    # Probability that the report detected each target, given that it exists, (T,). None if the
    # report is neither a sector nor of a sensor whose misses are correlated.
    detected: FloatArray | None
    # The report as a look at these targets; None if no sensor's misses are correlated.
    look: Look | None = None


def update(
    rows: RowsT,
    report: Report,
    steps: UpdateSteps[RowsT],
    dt: float,
    clutter: ClutterMemory | None = None,
    attributes: AttributesAt | None = None,
    earlier: Sequence[Newborn] = (),
    sensors: SensorMemory | None = None,
) -> Updated[RowsT]:
    """Update rows with one report.

    Parameters
    ----------
    steps : UpdateSteps
        The engine's steps.
    dt : float
        True interval since the previous scan, seconds.
    clutter : ClutterMemory or None
        Learned clutter, used and updated; None to use the sensor's model alone.
    attributes : AttributesAt or None
        Identities and heights of targets, used and updated; None to ignore them.
    earlier : sequence of Newborn
        Targets born at the detections of the scan's earlier reports.
    sensors : SensorMemory or None
        Learned detection probabilities and noise, used and updated; None to use the sensor's model
        alone.
    """
    model = steps.model
    if clutter is not None:
        report = clutter.with_learned_clutter(report)
    if sensors is not None:
        report = sensors.with_learned_sensor(report)
    prior = steps.prior(rows, report)
    limited = detection_limit.limit_detections(report, prior.measured, prior.mass)
    if clutter is not None:
        if limited is report:
            limited = clutter.with_surplus(report)
        clutter.count(report)
    if limited is not report:
        report, prior = limited, steps.prior(rows, limited)

    pairs = _gate_pairs(prior, report, attributes)
    out_of_gate = None if attributes is None else _out_of_gate(prior, pairs, report, attributes)
    if out_of_gate is not None:
        prior = prior.with_reacquired(out_of_gate)
        pairs = _gate_pairs(prior, report, attributes)
    evidence = None if attributes is None else _evidence(prior, pairs, report, attributes)
    report = _with_known_targets(report, prior)
    log_other = log_intensities(report, model, dt, earlier, evidence)
    posterior = prior.posterior(pairs, evidence, log_other)

    if clutter is not None and clutter.learns(report):
        bound = report.sensor.clutter_map_speed
        slower = posterior.claims.part(prior.probability_slower(bound))
        stationary = model.detection_births.stationary(slower, bound)
        clutter.learn(report, posterior.claimed_probability, stationary)
    if sensors is not None:
        _learn_sensor(sensors, report, model, prior, posterior)
    if attributes is not None and posterior.evidence is not None:
        attributes.learn(posterior.evidence, posterior.pair_probability, posterior.existence)
    newborn = posterior.sources.newborn(posterior.claimed_probability, report, model)
    newborns = () if newborn is None else (newborn,)
    detected = look = None
    needs_look = sensors is not None and sensors.needs_look(report)
    if needs_look or report.detections.coverage is not None:
        detected = _detected(prior, posterior)
        look = _look(report, prior, posterior, detected) if needs_look else None
    return Updated(posterior.rows, newborns, posterior.approximate, prior.label, detected, look)


def _with_known_targets(report: Report, prior: Prior[RowsT]) -> Report:
    """Return a report whose sensor has the false detections that the prior's targets cause."""
    if report.sensor.multipath is None:
        return report
    existence = sum_by(prior.target, prior.mass, len(prior.label))
    sensor = report.sensor.with_known_targets(prior.measured_by_target, existence)
    return replace(report, sensor=sensor)


def _existence_and_missed(prior: Prior[RowsT]) -> tuple[FloatArray, FloatArray]:
    """Return the weight of each target, and that of its missed detection, (T,)."""
    size = len(prior.label)
    return sum_by(prior.target, prior.mass, size), sum_by(prior.target, prior.missed_mass, size)


def _look(
    report: Report, prior: Prior[RowsT], posterior: Posterior[RowsT], detected: FloatArray
) -> Look:
    """Return a report as a look at the prior's targets."""
    before, missed = _existence_and_missed(prior)
    probability = 1.0 - missed / np.where(before > 0.0, before, 1.0)
    known = before, probability, detected, posterior.existence
    return look_at(report, prior.label, prior.measured_by_target, *known)


def _detected(prior: Prior[RowsT], posterior: Posterior[RowsT]) -> FloatArray:
    """Return the probability that a report detected each target, given that it exists, (T,)."""
    target = prior.target.take(posterior.claims.row)
    detected = sum_by(target, posterior.pair_probability, len(prior.label))
    return np.minimum(detected / np.maximum(posterior.existence, LEAST_EXISTENCE), 1.0)


def _learn_sensor(
    sensors: SensorMemory,
    report: Report,
    model: TrackerModel,
    prior: Prior[RowsT],
    posterior: Posterior[RowsT],
) -> None:
    """Learn a sensor's detection probability and noise from one report."""
    if posterior.noise is not None:
        sensors.learn_noise(report, posterior.noise)
    if not sensors.learns(report):
        return
    targets, claims, bound = len(prior.label), posterior.claims, report.sensor.clutter_map_speed
    before, missed = _existence_and_missed(prior)
    exists = np.where(before > 0.0, before, 1.0)
    known = before
    if report.sensor.clutter_map is not None and bound > 0.0:
        # Stationary targets are clutter, which may be detected less often than other targets.
        slow = sum_by(prior.target, prior.mass * prior.probability_slower(bound), targets)
        known = before * (1.0 - model.detection_births.stationary(slow / exists, bound))
    sensors.learn_detections(
        report,
        prior.label,
        prior.measured_by_target,
        before=known,
        probability=1.0 - missed / exists,
        detected=sum_by(prior.target.take(claims.row), posterior.pair_probability, targets),
        after=posterior.existence,
    )


def _gate_pairs(prior: Prior[RowsT], report: Report, attributes: AttributesAt | None) -> Paired:
    """Return the gated pairs of rows and detections."""
    if attributes is None:
        return plain(prior.gate, report.detections)
    return attributes.pair(prior.gate, prior.label, prior.target, report)


def _out_of_gate(
    prior: Prior[RowsT], pairs: Paired, report: Report, attributes: AttributesAt
) -> OutOfGate | None:
    """Return the targets whose identities are shown by detections outside their gates."""
    target = prior.target.take(pairs.row)
    return attributes.out_of_gate(prior.label, target, pairs.column, report.detections)


def _evidence(
    prior: Prior[RowsT], pairs: Paired, report: Report, attributes: AttributesAt
) -> Evidence | None:
    """Return the identities and heights of the detections as evidence for pairs."""
    existence, missed = _existence_and_missed(prior)
    target = prior.target.take(pairs.row)
    unseen = undetected(existence, missed)
    return attributes.evidence(prior.label, target, pairs.column, report.detections, unseen)


def update_scan(
    rows: RowsT,
    scan: Scan,
    steps: UpdateSteps[RowsT],
    dt: float,
    scan_index: int,
    clutter: ClutterMemory | None = None,
    attributes: AttributeMemory | None = None,
    passes: AntennaPasses | None = None,
    sensors: SensorMemory | None = None,
) -> UpdatedScan[RowsT]:
    """Update with the report of every sensor, in the configured order (iterated corrector).

    Targets born at the detections of one report join the rows before the next one, so that two
    sensors that detect a new target do not give birth to it twice.

    Parameters
    ----------
    rows : Rows
        Predicted.
    dt : float
        True interval since the previous scan, seconds.
    scan_index : int
        Determines the labels of births.
    attributes : AttributeMemory or None
    sensors : SensorMemory or None
        See `update`.
    passes : AntennaPasses or None
        Latest sectors of turning antennas, used and updated; None if no sectors are known.
    """
    label, approximate = labels.first_detected(scan_index), 0
    known = None if attributes is None else attributes.at(scan.stamp_ns)
    newborns: list[Newborn] = []
    for own in steps.model.reports(scan):
        report = own if passes is None else passes.with_earlier_sectors(own, scan.stamp_ns)
        if sensors is not None:
            report = sensors.with_look_prediction(report, scan.stamp_ns)
        updated = update(rows, report, steps, dt, clutter, known, newborns, sensors)
        rows, approximate = updated.rows, approximate + updated.approximate
        first = label
        for newborn in updated.newborns:
            rows, born = steps.with_newborn(rows, newborn, label)
            if known is not None:
                known.initiate(label, born.report.detections)
            label += len(born)
            newborns.append(born)
        if sensors is not None and updated.look is not None:
            look = updated.look.with_born(np.arange(first, label))
            sensors.learn_correlation(report, scan.stamp_ns, look)
        if passes is not None and updated.detected is not None:
            every = np.concatenate([updated.label, np.arange(first, label)])
            detected = np.concatenate([updated.detected, np.ones(label - first)])
            passes.learn(report, scan.stamp_ns, every, detected)
    return UpdatedScan(rows, tuple(newborns), approximate)
