"""The latest sectors of a turning antenna, and the targets that they have detected.

An antenna passes each target once per turn, so that a sector can only detect a target that the
adjoining sectors before it have not detected. Without this condition a target at the edge of two
sectors would be missed twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import numpy as np

from ..arrays import FloatArray, IntArray
from ..sensors.report import EarlierSectors, Report
from ..sensors.sensor import Sensor
from ..snapshot import MAX_STAMP_NS, Snapshot, floats, from_snapshot, integers, to_snapshot
from ..types import FULL_TURN, Coverage

NAME = "antenna_pass"
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
        after = sector.start - self.start - self.width
        before = self.start - sector.start - sector.width
        follows, precedes = (
            abs(math.remainder(gap, FULL_TURN)) <= MAX_GAP for gap in (after, before)
        )
        recent = 0 < stamp_ns - self.stamp_ns < SAME_PASS * turn_ns
        if not recent or follows == precedes:
            return None
        width = min(self.width + sector.width, WIDEST)
        start = sector.start + sector.width - width if follows else sector.start
        recently = self.seen_ns > stamp_ns - SAME_PASS * turn_ns
        seen = self.label[recently], self.unseen[recently], self.seen_ns[recently]
        return AntennaPass(stamp_ns, math.remainder(start, FULL_TURN), width, *seen)

    def detecting(self, label: IntArray, detected: FloatArray) -> AntennaPass:
        """Return the pass after detections of targets, (T,), given their probabilities."""
        if not len(label):
            return self
        every = np.union1d(self.label, label)
        unseen, seen_ns = np.ones(len(every)), np.full(len(every), self.stamp_ns)
        before, now = np.searchsorted(every, self.label), np.searchsorted(every, label)
        unseen[before], seen_ns[before] = self.unseen, self.seen_ns
        unseen[now] *= 1.0 - detected
        seen_ns[now] = self.stamp_ns
        return self._replace(label=every, unseen=unseen, seen_ns=seen_ns)


@dataclass
class AntennaPasses:
    """The latest sectors of each turning sensor."""

    # By sensor, after its first sector.
    passes: dict[str, AntennaPass] = field(default_factory=dict)

    def with_earlier_sectors(self, report: Report, stamp_ns: int) -> Report:
        """Return a report with the sectors before it in the same pass of the antenna."""
        continued = self._continued(report, stamp_ns)
        if continued is None:
            return report
        latest = self.passes[report.sensor.name]
        before = Coverage(latest.start, latest.width)
        return replace(report, earlier=EarlierSectors(before, continued.label, continued.unseen))

    def _continued(self, report: Report, stamp_ns: int) -> AntennaPass | None:
        """Return the pass that a report continues; None if it does not."""
        sector, latest = report.detections.coverage, self.passes.get(report.sensor.name)
        if sector is None or latest is None or sector.width > WIDEST:
            return None
        return latest.then(sector, stamp_ns, 1e9 * report.sensor.rotation_s)

    def learn(self, report: Report, stamp_ns: int, label: IntArray, detected: FloatArray) -> None:
        """Learn which targets a report has detected.

        Parameters
        ----------
        label : int array of shape (T,)
            Ascending.
        detected : array of shape (T,)
            Probability that each target was detected, given that it exists.
        """
        sector, sensor = report.detections.coverage, report.sensor
        if sector is None or not sector.turns or not sensor.rotation_s or sector.width > WIDEST:
            return
        latest = self._continued(report, stamp_ns) or AntennaPass.of(sector, stamp_ns)
        some = np.flatnonzero(detected > LEAST_DETECTED)
        self.passes = {**self.passes, sensor.name: latest.detecting(label[some], detected[some])}

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the passes in a snapshot."""
        for name, own in self.passes.items():
            to_snapshot(own, snapshot, f"{NAME}.{name}")

    @staticmethod
    def from_snapshot(snapshot: Snapshot, sensors: tuple[Sensor, ...]) -> AntennaPasses:
        """Return the stored passes of these sensors."""
        stored = snapshot.names_below(NAME)
        known = [sensor.name for sensor in sensors if sensor.name in stored]
        return AntennaPasses(
            {name: from_snapshot(AntennaPass, snapshot, f"{NAME}.{name}", {}) for name in known}
        )
