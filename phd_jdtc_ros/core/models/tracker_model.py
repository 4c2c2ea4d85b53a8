"""The models of targets and sensors of a tracker, in one value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..arrays import FloatArray, ReadOnly
from ..factors import AttributeModel, ClutterMap, Factor
from ..reports.model import Receiver
from ..sensors.gaussians import UNKNOWN_STD, HeightPrior
from ..sensors.range_rate import Rates
from ..sensors.sensor import Sensor
from ..sensors.view import View
from ..targets.amplitude_density import of_classes
from ..targets.birth import BirthTerm, SpawnModel
from ..targets.modes import ModeSpace
from ..types import Detections, Scan
from .amplitude_model import AmplitudeModel
from .detection_birth import DetectionBirthModel
from .detection_clusters import merge_clusters

# Where undetected targets are rarer than `least_mass` allows, targets are born with at least this
# share of their usual probability.
LEAST_SHARE = 0.5
# Number of places across a field of view where this probability is evaluated.
PLACES = 9
# Standard deviations of the velocity up to which a target is born whatever its range rate is.
FAST = 2.0


@dataclass(frozen=True)
class TrackerModel(ReadOnly):
    """Models of targets and sensors.

    Rates and probabilities refer to the mode space's nominal interval; the filter converts them to
    the true interval.
    """

    modes: ModeSpace  # Classes, their motion modes, and the transitions between these
    births: tuple[BirthTerm, ...]  # Births at known positions
    detection_births: DetectionBirthModel  # Births at detections
    spawn: SpawnModel
    amplitudes: AmplitudeModel
    radars: tuple[Sensor, ...]  # In the configured order, in which their reports update the targets
    # Further assumptions about each sensor, by its name; see `factors`.
    factors: Mapping[str, tuple[Factor, ...]] = field(default_factory=dict)
    # Model of identities and heights; None if no radar reports any.
    attributes: AttributeModel | None = None
    height_prior: HeightPrior | None = None  # Heights of undetected targets; None in the plane
    receivers: tuple[Receiver, ...] = ()  # Receivers of self-reports; see `reports`

    def reports(self, scan: Scan) -> list[View]:
        """Return the reports of a scan, each with its sensor at its pose, in the configured order.

        Detections of one object are merged, and amplitudes are dropped if the model ignores them.
        """
        return [
            View.of(
                sensor.at(detections.pose),
                self.amplitudes.select(
                    merge_clusters(detections, sensor) if sensor.cluster_distance else detections
                ),
                scan.stamp_ns,
            )
            for sensor, detections in zip(self.radars, scan.detections, strict=True)
            if detections is not None
        ]

    def expected(self, scan: Scan) -> list[View]:
        """Return the reports of a scan with what the factors of their sensors expect of them."""
        views = []
        for report in self.reports(scan):
            view = report
            for factor in self.factors.get(report.sensor.name, ()):
                view = factor.expect(view)
            views.append(view)
        return views

    @cached_property
    def noise_density(self) -> float:
        """Spectral density of the acceleration of targets in the plane, m^2/s^3.

        It is that of their liveliest motion: a mean over all would be too small in manoeuvres,
        which are rare.
        """
        axes = list(self.modes.space.velocity)
        return float(self.modes.noise(1.0)[:, axes, axes].mean(axis=1).max())

    @cached_property
    def measures_heights(self) -> bool:
        """Whether any sensor measures or reports heights, which follow from ranges alone if not."""
        return any(
            each.reported_heights is not None or (each.noise_std[2:] < UNKNOWN_STD).any()
            for each in self.radars
        )

    @cached_property
    def floor(self) -> float:
        """Floor of heights where these follow from ranges alone, metres; -inf otherwise."""
        if self.height_prior is None or self.measures_heights:
            return -math.inf
        return self.height_prior.floor

    @cached_property
    def largest_height_std(self) -> float:
        """Largest deviation of a height that is reported, metres; 0 if ranges show no height.

        One sensor of ranges alone cannot find heights, however narrow its hypotheses become.
        """
        found = self.measures_heights or len(self.radars) > 1
        return self.height_prior.largest_std if self.height_prior is not None and found else 0.0

    @property
    def has_clutter_map(self) -> bool:
        """Whether a map of false detections is learned for any sensor."""
        return any(isinstance(each, ClutterMap) for own in self.factors.values() for each in own)

    @property
    def learns_figures(self) -> bool:
        """Whether figures of the detection or the noise of any sensor, or receiver, are learned."""
        return bool(self.receivers) or any(
            each.learns_figures for own in self.factors.values() for each in own
        )

    def least_newborn_mass(self, view: View) -> float:
        """Return the smallest newborn mass with which a target is born at a sensor's detection.

        It is the births' `least_mass`, except if a detection without a reply, far from known
        targets, has less at some place of the field of view: no such target would ever be born.
        """
        least_mass = self.detection_births.least_mass
        places, unknown = self._unknown_density[view.sensor.name]
        if view.detection is not None:
            unknown = unknown * view.detection.mean
        clutter = math.exp(view.log_uniform_clutter) * view.clutter_ratio(places)
        if self.attributes is not None and self.attributes.replies:
            clutter *= self.attributes.reply_odds[0]
        usual = float((unknown / (unknown + clutter)).min()) if unknown.all() else 1.0
        return least_mass if usual > least_mass else LEAST_SHARE * usual

    @cached_property
    def _unknown_density(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Density of undetected targets among each sensor's detections, before learning.

        Each has places across the field of view, and the density there, (P, Z) and (P,).
        """
        return {sensor.name: self._unknown_density_of(sensor) for sensor in self.radars}

    def _unknown_density_of(self, sensor: Sensor) -> tuple[FloatArray, FloatArray]:
        places, view = np.zeros((PLACES, len(sensor.noise_std))), sensor.visibility
        columns, first = np.unique(view.limits[0], return_index=True)
        limits = np.clip(view.limits[1][first], 0.0, None)
        places[:, columns] = np.linspace(limits[:, 0], limits[:, 1], PLACES)
        p_d = view.detection_probability(places)
        by_class = of_classes(sensor.threshold, self.modes.classes) if p_d is None else p_d[:, None]
        births, interval_s = self.detection_births, self.modes.interval_s
        per_interval = (births.rate * by_class).sum(axis=-1) + np.zeros(PLACES)
        revolutions = (sensor.rotation_s or interval_s) / interval_s
        fast = np.full(PLACES, FAST * births.velocity_std)
        motion = sensor.motion_of(Detections(places, None, range_rate=fast))
        if isinstance(motion, Rates):
            per_interval *= births.rate_ratio(motion)
        return places, revolutions * per_interval / view.size
