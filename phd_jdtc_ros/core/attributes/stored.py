"""Stores beliefs about identities and heights in a snapshot, and restores them."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..snapshot import ROUNDING, Snapshot, from_snapshot, to_snapshot
from ..types import SENSORS
from .history import History
from .identity import CANDIDATES
from .memory import AttributeMemory
from .records import AttributeModel, AttributeRecords

NAME = "attributes"
SIZES = {"K": CANDIDATES, "W": CANDIDATES + 2, "A": 2, "S": len(SENSORS)}


def attributes_to_snapshot(memory: AttributeMemory, snapshot: Snapshot) -> None:
    """Store the memory's records and history."""
    to_snapshot(memory.records, snapshot, f"{NAME}.record")
    to_snapshot(memory.history, snapshot, f"{NAME}.history")


def attributes_from_snapshot(snapshot: Snapshot, model: AttributeModel) -> AttributeMemory:
    """Return the stored memory; an empty one if the snapshot has none.

    Raises
    ------
    ValueError
        If the tracker cannot have stored these values.
    """
    memory = AttributeMemory(model)
    if not snapshot.names_below(NAME):
        return memory
    records = from_snapshot(AttributeRecords, snapshot, f"{NAME}.record", SIZES)
    history = from_snapshot(History, snapshot, f"{NAME}.history", SIZES)
    _require_belief(f"{NAME}.record.code_weight", records.code_weight)
    _require_belief(f"{NAME}.record.address_weight", records.address_weight)
    order = np.lexsort((history.stamp_ns, history.label))
    if (np.diff(order) < 0).any():
        raise ValueError(f"{NAME}.history.origin: must be in order")
    memory.records, memory.history = records, history
    return memory


def _require_belief(name: str, weight: FloatArray) -> None:
    if (np.abs(weight.sum(axis=1) - 1.0) > ROUNDING).any():
        raise ValueError(f"{name}: must sum to one")
