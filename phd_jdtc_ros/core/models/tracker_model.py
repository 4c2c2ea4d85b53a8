"""What is assumed about targets and radars, in one value."""

from __future__ import annotations

from dataclasses import dataclass

from ..attributes.memory import AttributeModel
from ..sensors.polar_radar import RadarModel
from ..targets.birth import BirthTerm
from ..targets.modes import ModeSpace
from ..targets.spawn import SpawnModel
from ..types import Detections, Scan
from .amplitude_model import AmplitudeModel
from .detection_birth import DetectionBirthModel
from .detection_clusters import merged


@dataclass(frozen=True)
class TrackerModel:
    """Everything that an engine is told about targets and radars.

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
    radars : tuple of RadarModel
        In the order in which their detections are taken in.
    attributes : AttributeModel or None
        Of identities and heights; None where no radar reports any.
    """

    modes: ModeSpace
    births: tuple[BirthTerm, ...]
    detection_births: DetectionBirthModel
    spawn: SpawnModel
    amplitudes: AmplitudeModel
    radars: tuple[RadarModel, ...]
    attributes: AttributeModel | None = None

    def reports(self, scan: Scan) -> list[tuple[RadarModel, Detections]]:
        """Return the radars that reported in a scan, each where it was then, with what they saw.

        Detections that count as one are merged.
        """
        return [
            (radar.at(found.pose), merged(found, radar))
            for radar, found in zip(self.radars, scan.detections, strict=True)
            if found is not None
        ]
