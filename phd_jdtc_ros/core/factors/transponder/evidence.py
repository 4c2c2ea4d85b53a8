"""Likelihoods of a report's identities and heights, and the beliefs after an association.

An edge is a distinct (target, detection) pair. Several (row, detection) pairs of an engine have the
same edge, because identities and heights do not depend on the row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...arrays import TINY, BoolArray, FloatArray, IntArray, distinct_cells, sum_by
from ...types import UNKNOWN, Detections
from . import detection_times, height, identity
from .records import AttributeModel, AttributeRecords, Beliefs


class BeliefUpdate(NamedTuple):
    """Likelihoods of the edges' detections; None for an attribute that no detection reports."""

    before: Beliefs
    code: identity.ReplyLikelihood | None
    address: identity.ReplyLikelihood | None
    height: height.HeightUpdate | None

    def log_factor(self, edges: int) -> FloatArray:
        """Return the log factor of each edge's likelihood, (E,)."""
        total = np.zeros(edges)
        for update in (self.code, self.address, self.height):
            if update is not None:
                total += update.log_factor
        return total

    def after(
        self, target: IntArray, probability: FloatArray, missed: FloatArray
    ) -> tuple[Beliefs, BoolArray]:
        """Return the beliefs after an association, and a mask of the heights that restart.

        See `identity.update` and `height.update`.
        """
        edges, before = (target, probability, missed), self.before
        heights, restarted = before.heights, np.zeros(len(missed), dtype=np.bool_)
        if self.height is not None:
            heights, restarted = height.update(self.height, *edges)
        beliefs = Beliefs(
            before.code if self.code is None else identity.update(self.code, *edges),
            before.address if self.address is None else identity.update(self.address, *edges),
            heights,
        )
        return beliefs, restarted


def compare(
    before: Beliefs,
    target: IntArray,
    column: IntArray,
    detections: Detections,
    model: AttributeModel,
    conflict: FloatArray | float = 0.0,
) -> BeliefUpdate:
    """Return the likelihoods of the edges' detections; see `identity.compare`."""
    code, address, heights = detections.code, addresses_of(detections), detections.height
    time_s = np.zeros(len(detections)) if detections.time_s is None else detections.time_s
    return BeliefUpdate(
        before,
        None if code is None else identity.compare(before.code, target, code[column], model.code),
        None
        if address is None
        else identity.compare(before.address, target, address[column], model.address, conflict),
        None
        if heights is None
        else height.compare(before.heights, target, heights[column], time_s[column], model.height),
    )


@dataclass(frozen=True)
class Evidence:
    """Likelihoods of identities and heights of one report's detections."""

    # Log factor of each (row, detection) pair's likelihood, which the engine computes from the
    # state, (P,).
    log_factor: FloatArray
    log_clutter: FloatArray  # Log factor of the clutter intensity at each detection, (M,)
    # Log factor of the intensity of undetected targets at each detection, (M,).
    log_undetected: FloatArray
    edge_of_pair: IntArray  # Edge of each pair, (P,)
    target: IntArray  # Row in `before` of each edge's target, (E,)
    column: IntArray  # Detection of each edge, (E,)
    engine_target: IntArray  # The engine's index of each target that has an edge, (T,)
    before: AttributeRecords  # Records of these targets, predicted to the scan's stamp
    belief_update: BeliefUpdate
    detections: Detections

    def take(self, pairs: IntArray) -> Evidence:
        """Return the evidence of these pairs alone."""
        return replace(
            self, log_factor=self.log_factor[pairs], edge_of_pair=self.edge_of_pair[pairs]
        )

    def after(
        self, mass: FloatArray, existence: FloatArray, stamp_ns: int
    ) -> tuple[AttributeRecords, IntArray]:
        """Return the records that an association updates, and the labels of restarted heights.

        `mass` has the joint probability that each pair's target exists, is represented by its row
        and is the source of its detection, (P,). `existence` has the existence probability of each
        of the engine's targets after the update.
        """
        targets = len(self.engine_target)
        exists = np.maximum(existence[self.engine_target], TINY)
        probability = sum_by(self.edge_of_pair, mass, len(self.target)) / exists[self.target]
        total = sum_by(self.target, probability, targets)
        probability = probability / np.maximum(total, 1.0)[self.target]
        missed = np.maximum(1.0 - total, 0.0)
        beliefs, restarted = self.belief_update.after(self.target, probability, missed)
        seen_ns = detection_times.update(
            seen_ns=self.before.seen_ns,
            target=self.target,
            column=self.column,
            probability=probability,
            detections=self.detections,
            stamp_ns=stamp_ns,
        )
        records = AttributeRecords.of(self.before.label, stamp_ns, beliefs, seen_ns)
        # Smallest total association probability with which a target's beliefs are updated.
        min_total_probability = 1e-12
        updated = np.flatnonzero(total > min_total_probability)
        return records.take(updated), self.before.label[restarted]


def edges_of(
    target: IntArray, column: IntArray, targets: int, detections: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the target and the detection of each edge, (E,), and the edge of each pair, (P,)."""
    edge, edge_of_pair = distinct_cells(target * detections + column, targets * detections)
    return edge // max(detections, 1), edge % max(detections, 1), edge_of_pair


def log_clutter_factor(detections: Detections, model: AttributeModel) -> FloatArray:
    """Return the log factor of the clutter at each detection, (M,).

    Clutter with a reply shows identities as undetected targets do.
    """
    if detections.code is None and detections.address is None:
        return np.zeros(len(detections))
    factor: FloatArray = np.log(model.reply_odds)[replies_of(detections).astype(np.int64)]
    return factor


def replies_of(detections: Detections) -> BoolArray:
    """Return which detections show a code or an address, (M,)."""
    found = np.zeros(len(detections), dtype=np.bool_)
    for reply in (detections.code, detections.address):
        if reply is not None:
            found |= reply != UNKNOWN
    return found


def addresses_of(detections: Detections) -> IntArray | None:
    """Return the addresses; a missing one is no evidence if the code shows that no reply came."""
    if detections.address is None or detections.code is None:
        return detections.address
    silent = (detections.code == UNKNOWN) & (detections.address == UNKNOWN)
    return np.where(silent, identity.NOT_REPORTED, detections.address)
