"""The models of targets and sensors of a tracker, in one value."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ..arrays import ReadOnly
from ..attributes.records import AttributeModel
from ..sensors.report import Report
from ..sensors.sensor import Sensor
from ..targets.birth import BirthTerm
from ..targets.modes import ModeSpace
from ..targets.spawn import SpawnModel
from ..types import Scan
from .amplitude_model import AmplitudeModel
from .detection_birth import DetectionBirthModel
from .detection_clusters import merge_clusters


@dataclass(frozen=True)
class TrackerModel(ReadOnly):
    """Models of targets and sensors, shared by both engines.

    Rates and probabilities refer to the mode space's nominal interval; engines convert them to the
    true interval.
    """

    modes: ModeSpace  # Classes, their motion modes, and the transitions between these
    births: tuple[BirthTerm, ...]  # Births at known positions
    detection_births: DetectionBirthModel  # Births at detections
    spawn: SpawnModel
    amplitudes: AmplitudeModel
    radars: tuple[Sensor, ...]  # In the configured order, in which their reports update the targets
    # Model of identities and heights; None if no radar reports any.
    attributes: AttributeModel | None = None

    def reports(self, scan: Scan) -> list[Report]:
        """Return the reports of a scan, each with its sensor at its pose, in the configured order.

        Detections of one object are merged, and amplitudes are dropped if the model ignores them.
        The reports of the latest scan are made once.
        """
        for latest_scan, reports in self._latest:
            if latest_scan is scan:
                return reports
        reports = [
            Report(
                sensor.at(detections.pose),
                self.amplitudes.select(merge_clusters(detections, sensor)),
                scan.stamp_ns,
            )
            for sensor, detections in zip(self.radars, scan.detections, strict=True)
            if detections is not None
        ]
        self._latest[:] = [(scan, reports)]
        return reports

    @cached_property
    def _latest(self) -> list[tuple[Scan, list[Report]]]:
        return []
