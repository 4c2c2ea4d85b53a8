"""Models of identities and heights, the beliefs about targets, and their records by label."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...snapshot import MAX_STAMP_NS, MAX_STATE, ROUNDING, covariances, floats, integers
from ...types import UNKNOWN
from . import detection_times
from .height import HeightModel, Heights
from .identity import ADDRESSES, CODES, Belief, IdentityModel


@dataclass(frozen=True)
class AttributeModel:
    """Models of the identities and heights that detections report beside positions."""

    code: IdentityModel
    address: IdentityModel
    height: HeightModel
    clutter_reply: float = 0.05  # Probability that a false detection has a reply
    ages: bool = (
        False  # Whether estimates have the time of the last detection by each detection type
    )
    replies: bool = True  # Whether any sensor reports identities

    @property
    def reply_odds(self) -> tuple[float, float]:
        """Odds of a false detection against an undetected target's, without and with a reply."""
        false, true = self.clutter_reply, self.code.reply_probability
        return (1.0 - false) / (1.0 - true), false / true


class Beliefs(NamedTuple):
    """Beliefs about T targets."""

    code: Belief
    address: Belief
    heights: Heights

    @staticmethod
    def fresh(targets: int, model: AttributeModel) -> Beliefs:
        """Return the prior beliefs about new targets."""
        return Beliefs(
            Belief.fresh(targets, model.code),
            Belief.fresh(targets, model.address),
            Heights.fresh(targets),
        )

    def predict(self, dt: FloatArray, model: AttributeModel) -> Beliefs:
        """Return the beliefs `dt` seconds later, (T,); identities are not predicted backwards."""
        return Beliefs(
            self.code.predict(np.maximum(dt, 0.0), model.code),
            self.address.predict(np.maximum(dt, 0.0), model.address),
            self.heights.predict(dt, model.height),
        )


class AttributeRecords(NamedTuple):
    """Beliefs about T labels as columns."""

    label: Annotated[IntArray, integers("T", 0, ascending=True, key="origin")]  # Ascending, (T,)
    stamp_ns: Annotated[IntArray, integers("T", 0, MAX_STAMP_NS)]  # Time of the beliefs, (T,)
    # Belief about the code, (T, K) and (T, K + 2); see `identity.Belief`.
    code: Annotated[IntArray, integers("TK", UNKNOWN, CODES - 1)]
    code_weight: Annotated[FloatArray, floats("TW", 0.0, 1.0 + ROUNDING)]
    # Belief about the address, (T, K) and (T, K + 2).
    address: Annotated[IntArray, integers("TK", UNKNOWN, ADDRESSES - 1)]
    address_weight: Annotated[FloatArray, floats("TW", 0.0, 1.0 + ROUNDING)]
    # Density of the height, (T,), (T, 2) and (T, 2, 2); see `height.Heights`.
    height_known: Annotated[FloatArray, floats("T", 0.0, 1.0)]
    height: Annotated[FloatArray, floats("TA", -MAX_STATE, MAX_STATE)]
    height_covariance: Annotated[FloatArray, covariances("TAA", MAX_STATE)]
    # Time of the last detection by each detection type, (T, S); see `Attributes`.
    seen_ns: Annotated[IntArray, integers("TS", UNKNOWN, MAX_STAMP_NS)]

    @staticmethod
    def of(
        label: IntArray, stamp_ns: int, beliefs: Beliefs, seen_ns: IntArray | None = None
    ) -> AttributeRecords:
        """Return records of beliefs; without `seen_ns` no sensor has detected the targets."""
        stamps = np.full(len(label), stamp_ns, dtype=np.int64)
        seen_ns = detection_times.never(len(label)) if seen_ns is None else seen_ns
        columns = *beliefs.code, *beliefs.address, *beliefs.heights
        return AttributeRecords(label, stamps, *columns, seen_ns)

    @property
    def beliefs(self) -> Beliefs:
        """The beliefs without labels and stamps."""
        return Beliefs(
            Belief(self.code, self.code_weight),
            Belief(self.address, self.address_weight),
            Heights(self.height_known, self.height, self.height_covariance),
        )

    def take(self, rows: IntArray) -> AttributeRecords:
        """Return the records of these rows."""
        return AttributeRecords._make(column[rows] for column in self)

    def merge(self, other: AttributeRecords) -> AttributeRecords:
        """Return these records and others, which replace records of the same labels."""
        remaining = self.take(np.flatnonzero(~np.isin(self.label, other.label)))
        joined = AttributeRecords._make(map(np.concatenate, zip(remaining, other, strict=True)))
        return joined.take(np.argsort(joined.label, kind="stable"))
