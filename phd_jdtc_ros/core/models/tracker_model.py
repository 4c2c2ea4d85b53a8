"""The models of targets and sensors of a tracker, in one value."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

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

# Where unknown targets are rarer than `least_mass` allows, targets are born with at least this
# share of their usual probability.
LEAST_SHARE = 0.5


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

    def least_newborn_mass(self, sensor: Sensor) -> float:
        """Return the smallest newborn mass with which a target is born at a sensor's detection.

        It is the births' `least_mass`, except if a detection without a reply, amid uniform clutter
        and far from known targets, usually has less: no such target would ever be born.
        """
        least_mass, unknown = self.detection_births.least_mass, self._unknown_density[sensor.name]
        if sensor.detection_factor is not None:
            unknown *= sensor.detection_factor.mean
        clutter = math.exp(sensor.log_uniform_clutter)
        if self.attributes is not None and self.attributes.replies:
            clutter *= self.attributes.reply_odds[0]
        usual = unknown / (unknown + clutter) if unknown else 1.0
        return least_mass if usual > least_mass else LEAST_SHARE * usual

    @cached_property
    def _unknown_density(self) -> dict[str, float]:
        """Density of unknown targets among each sensor's detections, before anything is learned."""
        return {sensor.name: self._unknown_density_of(sensor) for sensor in self.radars}

    def _unknown_density_of(self, sensor: Sensor) -> float:
        middle = np.zeros((1, len(sensor.noise_std)))
        columns, first = np.unique(sensor.limits[0], return_index=True)
        middle[:, columns] = sensor.limits[1][first].mean(axis=1)
        p_d = sensor.configured_detection_probability(middle)
        p_d = sensor.class_detection_probability(self.modes.classes) if p_d is None else p_d
        turns = (sensor.rotation_s or self.modes.interval_s) / self.modes.interval_s
        return turns * float((self.detection_births.rate * p_d).sum()) / sensor.field_size

    @cached_property
    def _latest(self) -> list[tuple[Scan, list[Report]]]:
        return []
