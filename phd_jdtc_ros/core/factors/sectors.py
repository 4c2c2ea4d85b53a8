"""The latest sectors of a turning antenna, and the targets that they have detected.

An antenna passes each target once per revolution, so that a sector can only detect a target that
the adjoining sectors before it have not detected. Without this condition a target at the edge of
two sectors would be missed twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray, matches
from ..sensors.view import View
from ..snapshot import MAX_STAMP_NS, floats, integers, nested
from ..types import FULL_TURN, Coverage
from .factor import Factor, Look

# A pass covers the sectors within this share of a revolution.
SAME_PASS = 0.5
WIDEST = SAME_PASS * FULL_TURN
# Largest gap or overlap of adjoining sectors, radians; edges may be estimates.
MAX_GAP = 0.02
# Smallest probability that earlier sectors have not detected a target.
LEAST_UNSEEN = 1e-3


class AntennaPass(NamedTuple):
    """The sectors that an antenna has passed within half a revolution."""

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

    def then(self, sector: Coverage, stamp_ns: int, revolution_ns: float) -> AntennaPass | None:
        """Return the pass with a later sector; None if it does not adjoin.

        Detections more than half a revolution earlier are forgotten. Two halves of a revolution
        adjoin at both ends, so that it is unknown which of them is earlier in the pass.
        """
        gap_after = sector.start - self.start - self.width
        gap_before = self.start - sector.start - sector.width
        follows = abs(math.remainder(gap_after, FULL_TURN)) <= MAX_GAP
        precedes = abs(math.remainder(gap_before, FULL_TURN)) <= MAX_GAP
        recent = 0 < stamp_ns - self.stamp_ns < SAME_PASS * revolution_ns
        if not recent or follows == precedes:
            return None
        width = min(self.width + sector.width, WIDEST)
        start = sector.start + sector.width - width if follows else sector.start
        recently = self.seen_ns > stamp_ns - SAME_PASS * revolution_ns
        recent_columns = self.label[recently], self.unseen[recently], self.seen_ns[recently]
        return AntennaPass(stamp_ns, math.remainder(start, FULL_TURN), width, *recent_columns)

    def detecting(self, label: IntArray, detected: FloatArray) -> AntennaPass:
        """Return the pass after detections of targets of ascending labels, (T,).

        `detected` is the probability that each was detected, given that it exists, (T,).
        """
        from .loops import add_detections

        coverage = self.stamp_ns, self.start, self.width
        targets = self.label, self.unseen, self.seen_ns
        # Detections of a lower probability are not remembered.
        least_detected = 1e-3
        return AntennaPass(
            *coverage, *add_detections(self.stamp_ns, least_detected, *targets, label, detected)
        )


@dataclass(frozen=True)
class EarlierSectors:
    """The adjoining sectors before a report, in the same pass of the antenna."""

    coverage: Coverage  # Their azimuths
    continued: AntennaPass  # The pass that the report continues

    def factor(
        self, label: IntArray, in_revolution: FloatArray, measured: FloatArray
    ) -> FloatArray | None:
        """Return the factor on the probability of a detection; see `view.EarlierSectors`.

        An antenna passes a target once. If p_A and p_B are the probabilities that it is detected in
        the earlier sectors and in this one, it is detected in this one with p_B / (1 - p_A), given
        that the earlier ones have not detected it.
        """
        row, target = matches(self.continued.label, label)
        if not len(row) and measured.max(initial=0.0) <= LEAST_UNSEEN:
            return None
        unseen = np.ones(len(label))
        unseen[row] = np.maximum(self.continued.unseen[target], LEAST_UNSEEN)
        by_row = unseen.reshape(-1, *(1,) * (in_revolution.ndim - 1))
        factor: FloatArray = by_row / np.maximum(1.0 - in_revolution * measured, LEAST_UNSEEN)
        return factor


@dataclass(frozen=True)
class Sectors(Factor):
    """The pass of a turning antenna that the next sector may continue."""

    NAME: ClassVar[str] = "antenna_pass"

    latest: Annotated[AntennaPass | None, nested(AntennaPass)] = None

    def expect(self, view: View) -> View:
        """Return the report with the sectors before it in the same pass."""
        sector, latest = view.detections.coverage, self.latest
        if sector is None or latest is None or sector.width > WIDEST:
            return view
        continued = latest.then(sector, view.stamp_ns, 1e9 * view.sensor.rotation_s)
        if continued is None:
            return view
        earlier = EarlierSectors(Coverage(latest.start, latest.width), continued)
        return view.changed(earlier_sectors=earlier)

    def learn(self, look: Look) -> Sectors:
        """Continue the pass with a sector and its detections."""
        view, sector = look.view, look.view.detections.coverage
        if sector is None or not view.revolution_ns or sector.width > WIDEST:
            return self
        earlier = view.earlier_sectors
        latest = AntennaPass.of(sector, view.stamp_ns)
        if isinstance(earlier, EarlierSectors):
            latest = earlier.continued
        return self.changed(latest=latest.detecting(look.label, look.detected))
