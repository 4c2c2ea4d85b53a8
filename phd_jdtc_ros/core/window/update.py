"""The update of a set of rows with the reports of a scan, common to all engines.

Each report corrects the rows in turn. An engine implements the steps; see `update_steps`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic

import numpy as np

from ..association.claims import undetected
from ..attributes.evidence import Evidence
from ..attributes.memory import AttributeMemory, AttributesAt, Known
from ..attributes.reprojection import Paired, pair_as_reported
from ..attributes.uniqueness import OutOfGate
from ..learned.detection_chains import Look
from ..models import detection_limit
from ..models.competing_sources import log_intensities
from ..models.detection_birth import Newborn
from ..models.sensor_memory import SensorMemory
from ..sensors.report import Report
from ..tracks import labels
from ..types import Scan
from .learning import learn
from .update_steps import Prior, RowsT, UpdateSteps


@dataclass(frozen=True)
class UpdatedScan(Generic[RowsT]):
    """Rows after the reports of a scan."""

    rows: RowsT
    newborns: tuple[Newborn, ...]  # By report; empty if births at detections are disabled
    approximate: int  # Number of clusters of targets too large for exact association probabilities


@dataclass(frozen=True)
class Updated(UpdatedScan[RowsT]):
    """Rows after one report."""

    report: Report  # The report as `SensorMemory.prepare` returned it
    look: Look | None  # The report as a look at its targets; None if nothing is learned from it


def update(
    rows: RowsT,
    report: Report,
    steps: UpdateSteps[RowsT],
    dt: float,
    memory: SensorMemory | None = None,
    attributes: AttributesAt | None = None,
    earlier: Sequence[Newborn] = (),
) -> Updated[RowsT]:
    """Update rows with one report.

    Parameters
    ----------
    steps : UpdateSteps
        The engine's steps.
    dt : float
        True interval since the previous scan, seconds.
    memory : SensorMemory or None
        Learned values of the sensors, used and updated; None if nothing is learned yet.
    attributes : AttributesAt or None
        Identities and heights of targets, used and updated; None to ignore them.
    earlier : sequence of Newborn
        Targets born at the detections of the scan's earlier reports.
    """
    model, births = steps.model, steps.model.detection_births
    memory = memory or SensorMemory.of(model)
    prepared = report = memory.prepare(report)
    prior = steps.prior(rows, report)
    counted = memory.count(report)
    limited = detection_limit.limit_detections(report, prior.measured, prior.mass)
    if limited is report:
        limited = counted
    if limited is not report:
        report, prior = limited, steps.prior(rows, limited)

    pairs = _gate_pairs(prior, report, attributes)
    out_of_gate = (
        None if attributes is None else _find_out_of_gate(prior, pairs, report, attributes)
    )
    if out_of_gate is not None:
        prior = prior.with_reacquired(out_of_gate)
        pairs = _gate_pairs(prior, report, attributes)
    evidence = None if attributes is None else _evidence_of(prior, pairs, report, attributes)
    report = _with_known_targets(report, prior)
    looks, since_s = None, dt
    if births.enabled:  # nothing else depends on earlier looks
        looks = memory.earlier_looks(report, model)
        if looks is None and memory.others_looked(report):
            since_s = max(dt, model.modes.interval_s)
        memory.remember_look(report)
    log_other = log_intensities(report, model, since_s, earlier, evidence, looks)
    posterior = prior.posterior(pairs, evidence, log_other)

    look = learn(memory, report, model, prior, posterior)
    if attributes is not None and posterior.evidence is not None:
        attributes.learn(posterior.evidence, posterior.pair_probability, posterior.existence)
    newborns: tuple[Newborn, ...] = ()
    if births.enabled:
        # Without the clutter of a burst, in which new targets can wait.
        least_mass = model.least_newborn_mass(prepared.sensor)
        newborns = (posterior.sources.newborn(posterior.claimed_probability, report, least_mass),)
    return Updated(posterior.rows, newborns, posterior.approximate, prepared, look)


def _with_known_targets(report: Report, prior: Prior[RowsT]) -> Report:
    """Return a report whose sensor has the false detections that the prior's targets cause."""
    if report.sensor.multipath is None:
        return report
    sensor = report.sensor.with_known_targets(prior.measured_by_target, prior.existence)
    return report.changed(sensor=sensor)


def _gate_pairs(prior: Prior[RowsT], report: Report, attributes: AttributesAt | None) -> Paired:
    """Return the gated pairs of rows and detections."""
    if attributes is None:
        return pair_as_reported(prior.gate, report.detections)
    return attributes.pair(prior.gate, prior.label, prior.target, report)


def _find_out_of_gate(
    prior: Prior[RowsT], pairs: Paired, report: Report, attributes: AttributesAt
) -> OutOfGate | None:
    """Return the targets whose identities are shown by detections outside their gates."""
    target = prior.target.take(pairs.row)
    return attributes.out_of_gate(prior.label, target, pairs.column, report.detections)


def _evidence_of(
    prior: Prior[RowsT], pairs: Paired, report: Report, attributes: AttributesAt
) -> Evidence | None:
    """Return the identities and heights of the detections as evidence for pairs."""
    target = prior.target.take(pairs.row)
    unseen = undetected(prior.existence, prior.missed)
    place = report.sensor.to_world(prior.measured_by_target)
    known = Known(prior.label, place, prior.existence, unseen)
    return attributes.evidence(known, target, pairs.column, report)


def update_scan(
    rows: RowsT,
    scan: Scan,
    steps: UpdateSteps[RowsT],
    dt: float,
    scan_index: int,
    memory: SensorMemory | None = None,
    attributes: AttributeMemory | None = None,
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
    memory : SensorMemory or None
    attributes : AttributeMemory or None
        See `update`.
    """
    label, approximate = labels.first_detected(scan_index), 0
    attributes_now = None if attributes is None else attributes.at(scan.stamp_ns)
    memory = memory or SensorMemory.of(steps.model)
    newborns: list[Newborn] = []
    for report in steps.model.reports(scan):
        updated = update(rows, report, steps, dt, memory, attributes_now, newborns)
        rows, approximate = updated.rows, approximate + updated.approximate
        first = label
        for newborn in updated.newborns:
            rows, born = steps.with_newborn(rows, newborn, label)
            if attributes_now is not None:
                attributes_now.initiate(label, born.report.detections)
            label += len(born)
            newborns.append(born)
        if updated.look is not None:
            memory.learn_look(updated.report, updated.look.with_born(np.arange(first, label)))
    return UpdatedScan(rows, tuple(newborns), approximate)
