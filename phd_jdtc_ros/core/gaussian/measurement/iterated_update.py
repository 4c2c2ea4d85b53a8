"""The update of pairs of Gaussians and detections: heights, positions, then rates or velocities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray, frozen
from ...sensors.of_gaussians.linearised import Measured, WeightedGaussians, gaussians_of_groups
from ...sensors.view import View
from ...state_space import SPATIAL
from ..algebra import heavy_tails, kalman, range_rate
from ..mixture import Mixture
from .heights import coarse_heights, update_heights
from .velocity import FurtherUpdate, update_velocities


class PairUpdate(NamedTuple):
    """Innovations of pairs of Gaussians and detections, leading shape (P R,)."""

    # Innovation of the measurement without range rate, with the sensor's usual noise.
    innovation: kalman.Innovation
    # `innovation`, or that of the mixture of usual noise and outliers: `heavy_tails.mix_noises`.
    matched: kalman.Innovation
    # The Gaussians updated with heights, range rates or velocities too; None without any.
    further: range_rate.RateUpdate | FurtherUpdate | None
    # Probability that each detection is an outlier if it is the Gaussian's; None without outliers.
    outlier: FloatArray | None
    row: IntArray  # Hypothesis of each pair, (P,)
    column: IntArray  # Detection of each pair, (P,)
    report: View

    @property
    def log_likelihood(self) -> FloatArray:
        """Log likelihood of the measurement, with any height, rate or velocity, shape (P R,)."""
        if self.further is None:
            return self.matched.log_likelihood
        return self.matched.log_likelihood + self.further.log_likelihood

    def updated_gaussians(
        self, mixture: Mixture, row: IntArray, pair: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the updated Gaussians of hypotheses, (K, R, D) and (K, R, D, D).

        Parameters
        ----------
        row : int array of shape (K,)
            The hypothesis before the update.
        pair : int array of shape (K,)
            Its pair with a detection in this update; -1 for none, which keeps its Gaussians.
        """
        modes, size = mixture.mean.shape[1:]
        gaussians = mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size)
        if self.further is None:
            times = self.report.detections.time_s
            time_s = None if times is None else times[self.column].repeat(modes)
            mean, covariance = kalman.update(
                *gaussians, self.report.sensor, self.matched, time_s, (row, pair), modes
            )
        else:
            gaussian = gaussians_of_groups(row, modes)
            updated = gaussians_of_groups(pair, modes)
            mean, covariance = gaussians[0][gaussian], gaussians[1][gaussian]
            detected = updated >= 0
            mean[detected] = self.further.mean[updated[detected]]
            covariance[detected] = self.further.covariance[updated[detected]]
        return mean.reshape(-1, modes, size), covariance.reshape(-1, modes, size, size)


def iterated_update(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    report: View,
) -> PairUpdate:
    """Return the innovations of pairs, linearised at the posterior positions.

    Parameters
    ----------
    row, column : int arrays of shape (P,)
        Hypothesis and detection of each pair.
    """
    detections, sensor = report.detections, report.sensor
    rates = report.range_rates
    velocities = None if detections.velocity is None else report.velocities
    heights = None if detections.z is None else report.heights
    modes, size = mixture.mean.shape[1:]
    mean, covariance = mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size)
    weight, pairs = mixture.sums.mode_weight.reshape(-1), (row, column)
    own, time_s = None, None
    if rates is not None or velocities is not None or heights is not None:
        gaussian, detection = gaussians_of_groups(row, modes), column.repeat(modes)
        time_s = None if detections.time_s is None else detections.time_s[detection]
        own = mean[gaussian], covariance[gaussian]
    by_height = None
    if own is not None and heights is not None:
        by_height = update_heights(*own, heights.take(detection), time_s)
        mean, covariance = own = by_height.mean, by_height.covariance
        weight, pairs = weight[gaussian], (np.arange(len(row)), column)
    gaussians = frozen(WeightedGaussians(mean, covariance, weight))
    noise = report.detection_std, detections.noise_correlation
    measured = Measured(detections.measurement, *noise, detections.time_s)
    innovation = kalman.innovations(gaussians, sensor, measured, pairs, modes)
    matched, outlier = innovation, None
    if sensor.outliers is not None:
        matched, outlier = heavy_tails.mix_noises(innovation, sensor.outliers, *noise, column)
    further: range_rate.RateUpdate | FurtherUpdate | None = None
    if own is not None:
        updated = kalman.update(*own, sensor, matched, time_s)
        if rates is not None:
            further = range_rate.update_rates(*updated, sensor, rates.take(detection), time_s)
        elif velocities is not None:
            further = update_velocities(*updated, velocities.take(detection))
        if by_height is not None:
            log_height = by_height.log_likelihood
            further = (
                FurtherUpdate(*updated, log_height)
                if further is None
                else further._replace(log_likelihood=further.log_likelihood + log_height)
            )
    return PairUpdate(innovation, matched, further, outlier, row, column, report)


def coarse_further(
    mixture: Mixture, row: IntArray, column: IntArray, report: View
) -> FloatArray | None:
    """Return the log likelihood of rates or velocities, and heights, at the means, (P, R).

    The times of detections are ignored. The result is None if the report has none of them.
    """
    heights = None if report.detections.z is None else report.heights
    log_motion = _coarse_motion(mixture, row, column, report)
    if heights is None:
        return log_motion
    log_height = coarse_heights(mixture, row, heights.take(column))
    return log_height if log_motion is None else log_motion + log_height


def _coarse_motion(
    mixture: Mixture, row: IntArray, column: IntArray, report: View
) -> FloatArray | None:
    rates = report.range_rates
    if rates is None and report.detections.velocity is None:
        return None
    modes, size = mixture.mean.shape[1:]
    mean, covariance = mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size)
    if rates is not None:
        expected = range_rate.expected_rates(mean, covariance, report.sensor)
        rate, variance = (part.reshape(-1, modes) for part in (expected.rate, expected.variance))
        level = 1.0 if rates.level is None else rates.level[column][:, None]
        error = rates.rate[column][:, None] - level * rate[row]
        of_noise = rates.std[column][:, None] ** 2
        return rates.model.log_density(error, level**2 * variance[row] + of_noise)
    if (measured := report.velocities) is not None:
        axes = list(SPATIAL.motion[: measured.velocity.shape[1]])
        gaussian, detection = gaussians_of_groups(row, modes), column.repeat(modes)
        error = measured.velocity[detection] - mean[gaussian][:, axes]
        spread = covariance[gaussian][:, axes][:, :, axes] + measured.noise[detection]
        return measured.model.log_density(error, spread).reshape(-1, modes)
    return None
