"""What is assumed about targets and sensors, in one value."""

from __future__ import annotations

from dataclasses import dataclass

from ..attributes.memory import AttributeModel
from ..sensors.report import Report
from ..sensors.sensor import Sensor
from ..targets.birth import BirthTerm
from ..targets.modes import ModeSpace
from ..targets.spawn import SpawnModel
from ..types import Scan
from .amplitude_model import AmplitudeModel
from .detection_birth import DetectionBirthModel
from .detection_clusters import clustered


@dataclass(frozen=True)
class TrackerModel:
    """Assumptions that an engine makes about targets and sensors.

    Rates and probabilities are given for the mode space's nominal interval and converted to the
    true one.

    Parameters
    ----------
    modes : ModeSpace
        Classes, their motion modes, and the transitions between these.
    births : tuple of BirthTerm
        Births at known positions.
    detection_births : DetectionBirthModel
        Births at detections.
    spawn : SpawnModel
    amplitudes : AmplitudeModel
    radars : tuple of Sensor
        In the order in which their reports update the targets.
    attributes : AttributeModel or None
        Of identities and heights; None where no radar reports any.
    """

    modes: ModeSpace
    births: tuple[BirthTerm, ...]
    detection_births: DetectionBirthModel
    spawn: SpawnModel
    amplitudes: AmplitudeModel
    radars: tuple[Sensor, ...]
    attributes: AttributeModel | None = None

    def reports(self, scan: Scan) -> list[Report]:
        """Return the reports of a scan, each with its sensor at its pose, in the configured order.

        Detections of one object are merged, and amplitudes left out if the model ignores them.
        """
        return [
            Report(sensor.at(found.pose), self.amplitudes.used(clustered(found, sensor)))
            for sensor, found in zip(self.radars, scan.detections, strict=True)
            if found is not None
        ]
