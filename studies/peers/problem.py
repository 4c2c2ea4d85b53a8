"""A run in Stone Soup's types: its scans, and the information available to a tracker."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.targets.amplitude_density import of_classes
from phd_jdtc_ros.core.targets.motion import ConstantVelocity
from phd_jdtc_ros.study.tracker import SimulatedRun

from .conversion import EPOCH, STATE, detection, measurement_model
from .soup import Part, Soup, require


@dataclass(frozen=True)
class Problem:
    """A run with its model, and the parts of Stone Soup built from them."""

    soup: Soup
    run: SimulatedRun
    model: TrackerModel  # The model, with the run's radars
    # `predictor`, `updater`: stone Soup's extended Kalman predictor and updater for constant
    # velocity.
    predictor: Part
    updater: Part

    @staticmethod
    def of(run: SimulatedRun, model: TrackerModel) -> Problem:
        """Return the problem for a run, with the model's first motion of constant velocity."""
        soup = require()
        straight = next(m for m in model.modes.motions if isinstance(m, ConstantVelocity))
        axis = soup.ConstantVelocity(straight.noise_density)
        motion = soup.CombinedLinearGaussianTransitionModel([axis, axis])
        predictor = soup.ExtendedKalmanPredictor(motion)
        return Problem(soup, run, model, predictor, soup.ExtendedKalmanUpdater(None))

    @property
    def intervals(self) -> float:
        """The run's interval in units of the nominal interval."""
        return self.run.scenario.interval_s / self.model.modes.interval_s

    @property
    def survival_probability(self) -> float:
        """Probability to survive an interval of the run, mean over the classes."""
        nominal = np.mean([c.survival_probability for c in self.model.modes.classes])
        return float(nominal**self.intervals)

    def detection_probability(self, radar: RadarModel) -> float:
        """Return p_D: the radar's own if configured, or else the mean over the classes."""
        if radar.visibility.probabilities:
            return float(radar.visibility.probability(np.zeros(1))[0])
        return float(of_classes(radar.threshold, self.model.modes.classes).mean())

    def hypothesiser(self, gate: float) -> Part:
        """Return a gated hypothesiser by squared Mahalanobis distance of the innovation."""
        return self.soup.DistanceHypothesiser(
            predictor=self.predictor,
            updater=self.updater,
            measure=self.soup.SquaredMahalanobis(),
            missed_distance=gate**2,
        )

    def places(self, stamp: datetime) -> list[Part]:
        """Return the birth places as Gaussian states."""
        return [
            self.soup.GaussianState(
                term.mean[STATE].reshape(-1, 1), np.diag(term.std[STATE] ** 2), timestamp=stamp
            )
            for term in self.model.births
        ]

    @property
    def start_covariance(self) -> FloatArray:
        """Initial covariance of a track that starts anywhere; its position is the detection's."""
        if self.model.births:
            return np.diag(self.model.births[0].std[STATE] ** 2)
        return np.diag(np.full(len(STATE), self.model.detection_births.velocity_std) ** 2)

    def births(self, stamp: datetime) -> list[Part]:
        """Return the birth terms as mixture components, before the survival probability."""
        per_term = [
            float(term.rate.sum()) * self.intervals / self.survival_probability
            for term in self.model.births
        ]
        return [
            self.soup.TaggedWeightedGaussianState(
                place.state_vector, place.covar, timestamp=stamp, weight=weight
            )
            for place, weight in zip(self.places(stamp), per_term, strict=True)
        ]

    def scans(self) -> Iterator[tuple[datetime, list[tuple[RadarModel, set[Part]]]]]:
        """Yield every scan's stamp and its detections by radar."""
        soup, radars = self.soup, self.run.scenario.radars
        for scan in self.run.scans:
            stamp = EPOCH + timedelta(microseconds=scan.stamp_ns / 1000)
            looks = []
            for radar, report in zip(radars, scan.detections, strict=True):
                if report is not None:
                    sensor = measurement_model(soup, radar.at(report.pose))
                    found = {detection(soup, z, stamp, sensor) for z in report.measurement}
                    looks.append((radar, found))
            yield stamp, looks
