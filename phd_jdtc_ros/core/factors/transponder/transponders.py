"""Identity and height of each label from scan to scan, and their use in the update of a scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import IntArray, ReadOnly, matches
from ...association.claims import undetected
from ...association.evidence import Gate, OutOfGate, Paired, pair_as_reported
from ...sensors.polar_radar import RadarModel
from ...sensors.view import View
from ...snapshot import ROUNDING, Snapshot, from_snapshot, to_snapshot
from ...types import SENSORS, UNKNOWN, Attributes, Detections, Estimates
from ..factor import Look, Targets
from . import climbs, detection_times, reflections, reprojection, uniqueness
from .evidence import Evidence, addresses_of, compare, edges_of, log_clutter_factor, replies_of
from .history import History
from .identity import CANDIDATES, Belief
from .records import AttributeModel, AttributeRecords, Beliefs

# Smallest probability with which a height is known.
KNOWN_HEIGHT = 0.5
# Name and sizes of the arrays in a snapshot.
NAME = "attributes"
SIZES = {"K": CANDIDATES, "W": CANDIDATES + 2, "A": 2, "S": len(SENSORS)}


@dataclass(frozen=True, eq=False)
class Transponders(ReadOnly):
    """The beliefs about the identity and the height of every label, from scan to scan."""

    model: AttributeModel
    records: AttributeRecords
    history: History

    @staticmethod
    def of(model: AttributeModel) -> Transponders:
        """Return the beliefs before any detection."""
        none = np.zeros(0, dtype=np.int64)
        records = AttributeRecords.of(none, 0, Beliefs.fresh(0, model))
        return Transponders(model, records, History.empty())

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

    def of_labels(self, labels: Sequence[IntArray], stamp_ns: int) -> Transponders:
        """Return the beliefs about these labels, with heights that stamps from this one on need."""
        alive = np.concatenate(labels)
        records = self.records.take(np.flatnonzero(np.isin(self.records.label, alive)))
        return self.changed(records=records, history=self.history.since(stamp_ns, alive))

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

    def with_records(self, records: AttributeRecords, stamp_ns: int) -> Transponders:
        """Return the beliefs with new ones about some labels, and their known heights."""
        history = self.history
        with_height = np.flatnonzero(records.height_known > KNOWN_HEIGHT)
        if len(with_height):
            heights = records.beliefs.heights.take(with_height)
            history = history.record(records.label[with_height], stamp_ns, heights)
        return self.changed(records=self.records.merge(records), history=history)

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the records and the history in a snapshot."""
        to_snapshot(self.records, snapshot, f"{NAME}.record")
        to_snapshot(self.history, snapshot, f"{NAME}.history")

    def restored(self, snapshot: Snapshot) -> Transponders:
        """Return the stored beliefs; these ones if the snapshot has none.

        Raise `ValueError` if the tracker cannot have stored these values.
        """
        if not snapshot.names_below(NAME):
            return self
        records = from_snapshot(AttributeRecords, snapshot, f"{NAME}.record", SIZES)
        history = from_snapshot(History, snapshot, f"{NAME}.history", SIZES)
        for name in ("code_weight", "address_weight"):
            if (np.abs(getattr(records, name).sum(axis=1) - 1.0) > ROUNDING).any():
                raise ValueError(f"{NAME}.record.{name}: must sum to one")
        order = np.lexsort((history.stamp_ns, history.label))
        if (np.diff(order) < 0).any():
            raise ValueError(f"{NAME}.history.origin: must be in order")
        return self.changed(records=records, history=history)

    def pair(self, gate: Gate, targets: Targets, view: View) -> Paired:
        """Return the pairs in gates, with false heights replaced by those of the targets.

        Range rates of targets with known heights are without the part of the climb rate.
        """
        sensor, detections = view.sensor, view.detections
        if not isinstance(sensor, RadarModel) or detections.height is None:
            return pair_as_reported(gate, detections)
        projection = sensor.height_projection
        if projection is None:
            return pair_as_reported(gate, detections)
        heights = self.predict(targets.label, view.stamp_ns).beliefs.heights
        of_pairs = gate, targets.target, heights, view, projection, self.model.height
        pairs = reprojection.pair(*of_pairs)
        if detections.rise is None or sensor.range_rate is None:
            return pairs
        target = targets.target.take(pairs.row)
        return climbs.without_climbs(pairs, target, heights, projection, sensor.range_rate)

    def out_of_gate(self, targets: Targets, pairs: Paired, view: View) -> OutOfGate | None:
        """Return the targets whose identities detections show outside their gates."""
        reply = addresses_of(view.detections)
        if reply is None or not self.model.address.unique:
            return None
        identity, seen_ns = self.addresses(targets.label)
        reply_ns = detection_times.times_of(view.detections, view.stamp_ns)
        near = targets.target.take(pairs.row), pairs.column
        return uniqueness.find_out_of_gate(identity, seen_ns, reply, reply_ns, near)

    def evidence(self, targets: Targets, pairs: Paired, view: View) -> Evidence | None:
        """Return the likelihoods of the identities and heights of one report.

        The result is None if the radar reports neither identities, heights nor detection types, and
        the model has no `ages`.
        """
        model, size, detections = self.model, len(view), view.detections
        reported = detections.code, detections.address, detections.height, detections.detection_type
        if all(values is None for values in reported) and not model.ages:
            return None
        target = targets.target.take(pairs.row)
        edges = edges_of(target, pairs.column, len(targets.label), size)
        engine_target, column, edge_of_pair = edges
        distinct, target_index = np.unique(engine_target, return_inverse=True)
        target_index = target_index.ravel()
        prior = self.predict(targets.label[distinct], view.stamp_ns)
        address = addresses_of(detections)
        conflicts = uniqueness.identity_conflicts(
            belief=prior.beliefs.address,
            target=target_index,
            column=column,
            reply=np.full(size, UNKNOWN) if address is None else address,
            undetected=undetected(targets.existence, targets.missed)[distinct],
            model=model.address,
        )
        update = compare(
            prior.beliefs, target_index, column, detections, model, conflicts.by_another
        )
        log_factor = update.log_factor(len(target_index))
        log_clutter = log_clutter_factor(detections, model)
        replied = np.flatnonzero(replies_of(detections)[column])
        if len(replied):
            source, shown_by = engine_target[replied], column[replied]
            place = view.sensor.to_world(targets.measured_by_target)
            of_sources = place[source], targets.existence[source]
            ratio = reflections.log_reflections(*of_sources, shown_by, view)
            np.logaddexp.at(log_clutter, shown_by, ratio + log_factor[replied])
        return Evidence(
            log_factor=log_factor[edge_of_pair],
            log_clutter=log_clutter,
            log_undetected=conflicts.log_undetected,
            edge_of_pair=edge_of_pair,
            target=target_index,
            column=column,
            engine_target=distinct,
            before=prior,
            belief_update=update,
            detections=detections,
        )

    def after(self, look: Look) -> Transponders:
        """Return the beliefs after an association; see `Evidence.after`."""
        evidence, found, stamp_ns = look.association.evidence, look.association, look.view.stamp_ns
        beliefs = self
        if isinstance(evidence, Evidence) and len(evidence.engine_target):
            updated, restarted = evidence.after(found.pair_probability, found.existence, stamp_ns)
            beliefs = self.changed(history=self.history.without(restarted))
            beliefs = beliefs.with_records(updated, stamp_ns)
        if not len(look.born):
            return beliefs
        born_at = look.view.detections.take(look.born_at)
        return beliefs._initiated(look.born, born_at, stamp_ns)

    def _initiated(self, label: IntArray, detections: Detections, stamp_ns: int) -> Transponders:
        """Return the beliefs with those about targets born at detections, (B,)."""
        count = len(label)
        edge, certain = np.arange(count), np.ones(count)
        prior = Beliefs.fresh(count, self.model)
        update = compare(prior, edge, edge, detections, self.model)
        beliefs, _ = update.after(edge, certain, np.zeros(count))
        seen_ns = detection_times.update(
            detection_times.never(count), edge, edge, certain, detections, stamp_ns
        )
        return self.with_records(AttributeRecords.of(label, stamp_ns, beliefs, seen_ns), stamp_ns)
