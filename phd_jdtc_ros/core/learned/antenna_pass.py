"""The latest sectors of a turning antenna, and the targets that they have detected.

An antenna passes each target once per turn, so that a sector can only detect a target that the
adjoining sectors before it have not detected. Without this condition a target at the edge of two
sectors would be missed twice.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..compilation import Float1, Int1, compiled
from ..snapshot import MAX_STAMP_NS, floats, integers
from ..types import FULL_TURN, Coverage

# A pass covers the sectors within this share of a turn.
SAME_PASS = 0.5
WIDEST = SAME_PASS * FULL_TURN
# Largest gap or overlap of adjoining sectors, radians; edges may be estimates.
MAX_GAP = 0.02
# Detections of a lower probability are not remembered.
LEAST_DETECTED = 1e-3


class AntennaPass(NamedTuple):
    """The sectors that an antenna has passed within half a turn."""

    stamp_ns: Annotated[int, integers("", 0, MAX_STAMP_NS)]  # Stamp of the last sector
    # The azimuths that the sectors cover together, as in `Coverage`, radians.
    start: Annotated[float, floats("", -np.pi, np.pi)]
    width: Annotated[float, floats("", 1e-12, WIDEST)]
    # Labels of targets that these sectors may have detected, ascending, (K,).
    label: Annotated[IntArray, integers("K", 0, ascending=True)]
    # Probability that they have not detected each target, given that it exists, (K,).
    unseen: Annotated[FloatArray, floats("K", 0.0, 1.0)]
    # Stamp of the last sector that may have detected each target, (K,).
    seen_ns: Annotated[IntArray, integers("K", 0, MAX_STAMP_NS)]

    @staticmethod
    def of(sector: Coverage, stamp_ns: int) -> AntennaPass:
        """Return the pass of one sector, before any detection."""
        none, start = np.zeros(0, dtype=np.int64), math.remainder(sector.start, FULL_TURN)
        return AntennaPass(stamp_ns, start, sector.width, none, np.zeros(0), none)

    def then(self, sector: Coverage, stamp_ns: int, turn_ns: float) -> AntennaPass | None:
        """Return the pass with a later sector; None if it does not adjoin.

        Detections more than half a turn earlier are forgotten. Two halves of a turn adjoin at both
        ends, so that it is unknown which of them is earlier in the pass.
        """
        gap_after = sector.start - self.start - self.width
        gap_before = self.start - sector.start - sector.width
        follows = abs(math.remainder(gap_after, FULL_TURN)) <= MAX_GAP
        precedes = abs(math.remainder(gap_before, FULL_TURN)) <= MAX_GAP
        recent = 0 < stamp_ns - self.stamp_ns < SAME_PASS * turn_ns
        if not recent or follows == precedes:
            return None
        width = min(self.width + sector.width, WIDEST)
        start = sector.start + sector.width - width if follows else sector.start
        recently = self.seen_ns > stamp_ns - SAME_PASS * turn_ns
        recent_columns = self.label[recently], self.unseen[recently], self.seen_ns[recently]
        return AntennaPass(stamp_ns, math.remainder(start, FULL_TURN), width, *recent_columns)

    def detecting(self, label: IntArray, detected: FloatArray) -> AntennaPass:
        """Return the pass after detections of targets of ascending labels, (T,).

        `detected` is the probability that each was detected, given that it exists, (T,).
        """
        coverage = self.stamp_ns, self.start, self.width
        targets = self.label, self.unseen, self.seen_ns
        return AntennaPass(*coverage, *_add_detections(self.stamp_ns, *targets, label, detected))


@compiled
def _add_detections(
    stamp_ns: int,
    label: Int1,
    unseen: Float1,
    seen_ns: Int1,
    detected_label: Int1,
    detected: Float1,
) -> tuple[IntArray, FloatArray, IntArray]:
    """Return the columns of a pass after detections of targets with these labels."""
    count, row, written = len(label), 0, 0
    most = count + len(detected_label)
    labels = np.empty(most, np.int64)
    unseen_after = np.empty(most)
    stamps = np.empty(most, np.int64)
    for index in range(len(detected_label) + 1):
        if index < len(detected_label) and not detected[index] > LEAST_DETECTED:
            continue
        while row < count and (index == len(detected_label) or label[row] < detected_label[index]):
            labels[written], stamps[written] = label[row], seen_ns[row]
            unseen_after[written] = unseen[row]
            row, written = row + 1, written + 1
        if index < len(detected_label):
            is_known = row < count and label[row] == detected_label[index]
            labels[written], stamps[written] = detected_label[index], stamp_ns
            unseen_after[written] = (unseen[row] if is_known else 1.0) * (1.0 - detected[index])
            row, written = row + is_known, written + 1
    return labels[:written].copy(), unseen_after[:written].copy(), stamps[:written].copy()
