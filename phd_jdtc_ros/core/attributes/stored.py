"""Storage of what is known of identities and heights in a snapshot, and its restoration.

`snapshot` says why every value is checked.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..snapshot import (
    MOST_INDEX,
    MOST_STAMP_NS,
    AnyArray,
    Snapshot,
    require_covariances,
    require_numbers,
    require_whole,
    whole,
)
from ..types import SENSORS, UNKNOWN
from .history import History
from .identity import ADDRESSES, CANDIDATES, CODES
from .memory import AttributeMemory, AttributeModel, Records

NAME = "attributes"
# Of heights and climb rates, metres and metres per second; of sums that are one.
MOST, ROUNDING = 1e9, 1e-6
SHAPES = {
    "code": (CANDIDATES,),
    "code_weight": (CANDIDATES + 2,),
    "address": (CANDIDATES,),
    "address_weight": (CANDIDATES + 2,),
    "height": (2,),
    "height_covariance": (2, 2),
    "mean": (2,),
    "covariance": (2, 2),
    "seen_ns": (len(SENSORS),),
}


def put_attributes(snapshot: Snapshot, memory: AttributeMemory) -> None:
    """Store what is known."""
    snapshot.facts[NAME] = {
        "origins": len(memory.records.origin),
        "heights": len(memory.history.origin),
    }
    for part, value in (("record", memory.records), ("history", memory.history)):
        for name, column in zip(value._fields, value, strict=True):
            snapshot.arrays[f"{NAME}.{part}.{name}"] = column


def take_attributes(snapshot: Snapshot, model: AttributeModel) -> AttributeMemory:
    """Return what is known; nothing where the snapshot has none.

    Raises
    ------
    ValueError
        If it is nothing that the tracker could have stored.
    """
    memory = AttributeMemory(model)
    if NAME not in snapshot.facts:
        return memory
    facts = snapshot.facts[NAME]
    origins = whole(f"{NAME}.origins", facts["origins"], 0, MOST_INDEX)
    heights = whole(f"{NAME}.heights", facts["heights"], 0, MOST_INDEX)
    columns: list[Any] = [_column(snapshot, "record", name, origins) for name in Records._fields]
    records = Records(*columns)
    columns = [_column(snapshot, "history", name, heights) for name in History._fields]
    history = History(*columns)
    name = f"{NAME}.record"
    _require_origins(name, records.origin, records.stamp_ns)
    if (np.diff(records.origin) <= 0).any():
        raise ValueError(f"{name}.origin: must increase")
    _require_belief(f"{name}.code", records.code, records.code_weight, CODES)
    _require_belief(f"{name}.address", records.address, records.address_weight, ADDRESSES)
    require_numbers(f"{name}.height_known", records.height_known, 0.0, 1.0)
    _require_heights(f"{name}.height", records.height, records.height_covariance)
    require_whole(f"{name}.seen_ns", records.seen_ns, UNKNOWN, MOST_STAMP_NS)
    name = f"{NAME}.history"
    _require_origins(name, history.origin, history.stamp_ns)
    if (np.lexsort((history.stamp_ns, history.origin)) != np.arange(heights)).any():
        raise ValueError(f"{name}.origin: must be in order")
    _require_heights(name, history.mean, history.covariance)
    memory.records, memory.history = records, history
    return memory


def _column(snapshot: Snapshot, part: str, name: str, count: int) -> AnyArray:
    full = f"{NAME}.{part}.{name}"
    column = snapshot.array(full)
    if column.shape != (count, *SHAPES.get(name, ())):
        raise ValueError(f"{full}: shape {column.shape}, expected {count} rows")
    return column


def _require_origins(name: str, origin: AnyArray, stamp_ns: AnyArray) -> None:
    require_whole(f"{name}.origin", origin, 0, MOST_INDEX)
    require_whole(f"{name}.stamp_ns", stamp_ns, 0, MOST_STAMP_NS)


def _require_belief(name: str, candidate: AnyArray, weight: AnyArray, size: int) -> None:
    require_whole(name, candidate, UNKNOWN, size - 1)
    require_numbers(f"{name}_weight", weight, 0.0, 1.0 + ROUNDING)
    if (np.abs(weight.sum(axis=1) - 1.0) > ROUNDING).any():
        raise ValueError(f"{name}_weight: must sum to one")


def _require_heights(name: str, mean: AnyArray, covariance: AnyArray) -> None:
    require_numbers(name, mean, -MOST, MOST)
    require_numbers(f"{name}_covariance", covariance, -(MOST**2), MOST**2)
    require_covariances(f"{name}_covariance", covariance)
