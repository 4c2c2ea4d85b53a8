# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A run in Stone Soup's types: its scans, and the information that a tracker is given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from phd_jdtc_ros.core.configuration.build import resolve
from phd_jdtc_ros.core.models.motion import ConstantVelocity
from phd_jdtc_ros.core.models.radar import RadarModel
from phd_jdtc_ros.core.models.tracker_model import TrackerModel

from ..runs import SimulatedRun
from .conversion import EPOCH, STATE, detection, measurement_model
from .soup import Part, Soup, require


@dataclass(frozen=True)
class Problem:
    """A run with its model, and the parts of Stone Soup that are built from them.

    Parameters
    ----------
    soup : Soup
    run : SimulatedRun
    model : TrackerModel
        Of the reference configuration; the radars are the run's own.
    predictor, updater : Part
        Of Stone Soup: extended Kalman, constant velocity.
    """

    soup: Soup
    run: SimulatedRun
    model: TrackerModel
    predictor: Part
    updater: Part

    @staticmethod
    def of(run: SimulatedRun) -> Problem:
        """Return the problem for a run."""
        soup = require()
        model = resolve({}).model
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
        """Return p_D, mean over the classes."""
        return float(radar.class_detection_probability(self.model.modes.classes).mean())

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

    def births(self, stamp: datetime) -> list[Part]:
        """Return the birth terms as mixture components, before survival is applied to them."""
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
        sensors = [measurement_model(soup, radar) for radar in radars]
        for scan in self.run.scans:
            stamp = EPOCH + timedelta(microseconds=scan.stamp_ns / 1000)
            looks = [
                (radar, {detection(soup, z, stamp, sensor) for z in report.measurement})
                for radar, sensor, report in zip(radars, sensors, scan.detections, strict=True)
                if report is not None
            ]
            yield stamp, looks
