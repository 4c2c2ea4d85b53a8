"""Identity and height of each label from scan to scan, and their use in the update of a scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, matches
from ..sensors.report import Report
from ..snapshot import ROUNDING, Snapshot, from_snapshot, to_snapshot
from ..types import SENSORS, UNKNOWN, Attributes, Detections, Estimates
from . import detection_times, reflections, reprojection, uniqueness
from .evidence import Evidence, addresses_of, compare, edges_of, log_clutter_factor, replies_of
from .history import History
from .identity import CANDIDATES, Belief
from .records import AttributeModel, AttributeRecords, Beliefs
from .reprojection import Gate, Paired
from .uniqueness import OutOfGate

# Smallest probability with which a height is known.
KNOWN_HEIGHT = 0.5
# Name and sizes of the arrays in a snapshot.
NAME = "attributes"
SIZES = {"K": CANDIDATES, "W": CANDIDATES + 2, "A": 2, "S": len(SENSORS)}


class AttributeMemory:
    """Keeps the beliefs about every label from scan to scan."""

    def __init__(self, model: AttributeModel) -> None:
        self.model = model
        none = np.zeros(0, dtype=np.int64)
        self.records = AttributeRecords.of(none, 0, Beliefs.fresh(0, model))
        self.history = History.empty()

    def at(self, stamp_ns: int) -> AttributesAt:
        """Return the memory at a scan's stamp, for the engine's update."""
        return AttributesAt(self, stamp_ns)

    def describe(self, estimates: Estimates, smoothed: bool) -> Estimates:
        """Return estimates, whose `track_id` is still label + 1, with heights and identities.

        Heights are smoothed by later scans on request; identities are always the latest.
        """
        label = estimates.track_id - 1
        records = self.predict(label, estimates.stamp_ns)
        beliefs = records.beliefs
        heights = beliefs.heights
        is_known = heights.known > KNOWN_HEIGHT
        if smoothed:
            heights = self.history.smooth(label, estimates.stamp_ns, self.model.height)
            is_known &= heights.known > KNOWN_HEIGHT
        return replace(
            estimates,
            attributes=Attributes(
                height=np.where(is_known[:, None], heights.mean, np.nan),
                height_covariance=np.where(is_known[:, None, None], heights.covariance, np.nan),
                code=beliefs.code.most_probable(),
                address=beliefs.address.most_probable(),
                seen_ns=records.seen_ns if self.model.ages and not smoothed else None,
            ),
        )

    def addresses(self, label: IntArray) -> tuple[IntArray, IntArray]:
        """Return the address of each label, or `UNKNOWN`, and the time of its last detection."""
        address, seen_ns = np.full((2, len(label)), UNKNOWN)
        row, record = matches(self.records.label, label)
        records = self.records
        address[row] = Belief(
            records.address[record], records.address_weight[record]
        ).most_probable()
        seen_ns[row] = records.seen_ns[record].max(axis=1)
        return address, seen_ns

    def forget_all_but(self, labels: Sequence[IntArray], stamp_ns: int) -> None:
        """Drop labels that are gone, and heights that no stamp from this one on needs."""
        alive = np.concatenate(labels)
        self.records = self.records.take(np.flatnonzero(np.isin(self.records.label, alive)))
        self.history = self.history.since(stamp_ns, alive)

    def predict(self, label: IntArray, stamp_ns: int) -> AttributeRecords:
        """Return the records of labels, predicted to a stamp; priors for labels without one."""
        result = AttributeRecords.of(label, stamp_ns, Beliefs.fresh(len(label), self.model))
        row, record = matches(self.records.label, label)
        stored = self.records.take(record)
        dt = (stamp_ns - stored.stamp_ns).astype(np.float64) * 1e-9
        beliefs = stored.beliefs.predict(dt, self.model)
        predicted = AttributeRecords.of(stored.label, stamp_ns, beliefs, stored.seen_ns)
        for column, value in zip(result[2:], predicted[2:], strict=True):
            column[row] = value
        return result

    def store(self, records: AttributeRecords, stamp_ns: int) -> None:
        """Replace the records of some labels, and add their known heights to the history."""
        self.records = self.records.merge(records)
        with_height = np.flatnonzero(records.height_known > KNOWN_HEIGHT)
        if len(with_height):
            heights = records.beliefs.heights.take(with_height)
            self.history = self.history.record(records.label[with_height], stamp_ns, heights)

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the records and the history in a snapshot."""
        to_snapshot(self.records, snapshot, f"{NAME}.record")
        to_snapshot(self.history, snapshot, f"{NAME}.history")

    @staticmethod
    def from_snapshot(snapshot: Snapshot, model: AttributeModel) -> AttributeMemory:
        """Return the stored memory; an empty one if the snapshot has none.

        Raise `ValueError` if the tracker cannot have stored these values.
        """
        memory = AttributeMemory(model)
        if not snapshot.names_below(NAME):
            return memory
        records = from_snapshot(AttributeRecords, snapshot, f"{NAME}.record", SIZES)
        history = from_snapshot(History, snapshot, f"{NAME}.history", SIZES)
        for name in ("code_weight", "address_weight"):
            if (np.abs(getattr(records, name).sum(axis=1) - 1.0) > ROUNDING).any():
                raise ValueError(f"{NAME}.record.{name}: must sum to one")
        order = np.lexsort((history.stamp_ns, history.label))
        if (np.diff(order) < 0).any():
            raise ValueError(f"{NAME}.history.origin: must be in order")
        memory.records, memory.history = records, history
        return memory


class Known(NamedTuple):
    """An engine's T targets before a report."""

    label: IntArray  # (T,)
    place: FloatArray  # Expected positions, world frame, metres, (T, 2)
    existence: FloatArray  # Existence probabilities, (T,)
    # Existence probabilities, given that the report does not detect the target, (T,).
    undetected: FloatArray


class AttributesAt(NamedTuple):
    """The attribute memory at the stamp of a scan, as an engine's update uses it.

    `label`, (T,), has the labels of the engine's targets; `target` and `column`, (P,), have the
    target and the detection of each gated (row, detection) pair.
    """

    memory: AttributeMemory
    stamp_ns: int

    def pair(self, gate: Gate, label: IntArray, target: IntArray, report: Report) -> Paired:
        """Return the pairs in gates, with false heights replaced by those of the targets.

        `target` has the target of each of the engine's rows, (N,).
        """
        projection, detections = report.sensor.height_projection, report.detections
        if projection is None or detections.height is None:
            return reprojection.pair_as_reported(gate, detections)
        heights = self.memory.predict(label, self.stamp_ns).beliefs.heights
        return reprojection.pair(
            gate, target, heights, report, projection, self.memory.model.height
        )

    def out_of_gate(
        self, label: IntArray, target: IntArray, column: IntArray, detections: Detections
    ) -> OutOfGate | None:
        """Return the targets whose identities detections show outside their gates."""
        reply = addresses_of(detections)
        if reply is None or not self.memory.model.address.unique:
            return None
        identity, seen_ns = self.memory.addresses(label)
        reply_ns = detection_times.times_of(detections, self.stamp_ns)
        return uniqueness.find_out_of_gate(identity, seen_ns, reply, reply_ns, (target, column))

    def evidence(
        self,
        known: Known,
        target: IntArray,
        column: IntArray,
        report: Report,
    ) -> Evidence | None:
        """Return the likelihoods of the identities and heights of one report.

        The result is None if the radar reports neither identities, heights nor sensor types, and
        the model has no `ages`.
        """
        model, size, detections = self.memory.model, len(report), report.detections
        reported = detections.code, detections.address, detections.height, detections.sensor_type
        if all(values is None for values in reported) and not model.ages:
            return None
        engine_target, column, edge_of_pair = edges_of(target, column, len(known.label), size)
        distinct, target_index = np.unique(engine_target, return_inverse=True)
        target_index = target_index.ravel()
        prior = self.memory.predict(known.label[distinct], self.stamp_ns)
        address = addresses_of(detections)
        conflicts = uniqueness.identity_conflicts(
            belief=prior.beliefs.address,
            target=target_index,
            column=column,
            reply=np.full(size, UNKNOWN) if address is None else address,
            undetected=known.undetected[distinct],
            model=model.address,
        )
        edges = target_index, column, detections, model, conflicts.by_another
        update = compare(prior.beliefs, *edges)
        log_factor = update.log_factor(len(target_index))
        log_clutter = log_clutter_factor(detections, model)
        replied = np.flatnonzero(replies_of(detections)[column])
        if len(replied):
            source, shown_by = engine_target[replied], column[replied]
            of_sources = known.place[source], known.existence[source]
            ratio = reflections.log_reflections(*of_sources, shown_by, report)
            np.logaddexp.at(log_clutter, shown_by, ratio + log_factor[replied])
        return Evidence(
            log_factor=log_factor[edge_of_pair],
            log_clutter=log_clutter,
            log_unknown=conflicts.log_unknown,
            edge_of_pair=edge_of_pair,
            target=target_index,
            column=column,
            engine_target=distinct,
            before=prior,
            belief_update=update,
            detections=detections,
        )

    def learn(self, evidence: Evidence, mass: FloatArray, existence: FloatArray) -> None:
        """Update the beliefs after an association; see `Evidence.after`."""
        if len(evidence.engine_target):
            updated, restarted = evidence.after(mass, existence, self.stamp_ns)
            self.memory.history = self.memory.history.without(restarted)
            self.memory.store(updated, self.stamp_ns)

    def initiate(self, label: int, detections: Detections) -> None:
        """Initiate the beliefs about targets born at detections from these detections.

        Their labels are consecutive from `label`.
        """
        count = len(detections)
        if not count:
            return
        edge, certain = np.arange(count), np.ones(count)
        prior = Beliefs.fresh(count, self.memory.model)
        update = compare(prior, edge, edge, detections, self.memory.model)
        beliefs, _ = update.after(edge, certain, np.zeros(count))
        seen_ns = detection_times.update(
            detection_times.never(count), edge, edge, certain, detections, self.stamp_ns
        )
        records = AttributeRecords.of(label + edge, self.stamp_ns, beliefs, seen_ns)
        self.memory.store(records, self.stamp_ns)
