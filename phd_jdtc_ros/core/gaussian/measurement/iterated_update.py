"""The update of pairs of Gaussians and detections: first positions, then rates or velocities."""

from __future__ import annotations

from typing import NamedTuple

from ...arrays import FloatArray, IntArray
from ...sensors.of_gaussians.linearised import Measured, WeightedGaussians, gaussians_of_groups
from ...sensors.view import View
from ..algebra import heavy_tails, kalman, range_rate
from ..mixture import Mixture
from .velocity import VelocityUpdate, update_velocities


class PairUpdate(NamedTuple):
    """Innovations of pairs of Gaussians and detections, leading shape (P R,)."""

    # Innovation of the measurement without range rate, with the sensor's usual noise.
    innovation: kalman.Innovation
    # `innovation`, or that of the mixture of usual noise and outliers: `heavy_tails.mix_noises`.
    matched: kalman.Innovation
    # The Gaussians updated with range rates or velocities too; None if the report has none.
    motion_update: range_rate.RateUpdate | VelocityUpdate | None
    # Probability that each detection is an outlier if it is the Gaussian's; None without outliers.
    outlier: FloatArray | None
    row: IntArray  # Hypothesis of each pair, (P,)
    column: IntArray  # Detection of each pair, (P,)
    report: View

    @property
    def log_likelihood(self) -> FloatArray:
        """Log likelihood of the measurement, including any rate or velocity, shape (P R,)."""
        if self.motion_update is None:
            return self.matched.log_likelihood
        return self.matched.log_likelihood + self.motion_update.log_likelihood

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
        if self.motion_update is None:
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
            mean[detected] = self.motion_update.mean[updated[detected]]
            covariance[detected] = self.motion_update.covariance[updated[detected]]
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
    modes, size = mixture.mean.shape[1:]
    mean, covariance = mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size)
    gaussians = WeightedGaussians.of(mean, covariance, mixture.mode_weight.reshape(-1))
    noise = report.detection_std, detections.noise_correlation
    measured = Measured(detections.measurement, *noise, detections.time_s)
    innovation = kalman.innovations(gaussians, sensor, measured, (row, column), modes)
    matched, outlier = innovation, None
    if sensor.outliers is not None:
        matched, outlier = heavy_tails.mix_noises(innovation, sensor.outliers, *noise, column)
    motion_update: range_rate.RateUpdate | VelocityUpdate | None = None
    if rates is not None or velocities is not None:
        gaussian, detection = gaussians_of_groups(row, modes), column.repeat(modes)
        time_s = None if detections.time_s is None else detections.time_s[detection]
        updated = kalman.update(mean[gaussian], covariance[gaussian], sensor, matched, time_s)
        if rates is not None:
            own_rates = rates.take(detection)
            motion_update = range_rate.update_rates(*updated, sensor, own_rates, time_s)
        elif velocities is not None:
            motion_update = update_velocities(*updated, sensor.space, velocities.take(detection))
    return PairUpdate(innovation, matched, motion_update, outlier, row, column, report)


def coarse_motion(
    mixture: Mixture, row: IntArray, column: IntArray, report: View
) -> FloatArray | None:
    """Return the log likelihood of the rates or velocities of pairs at the predicted means, (P, R).

    The times of detections are ignored. The result is None if the report has neither.
    """
    rates = report.range_rates
    if rates is None and report.detections.velocity is None:
        return None
    modes, size = mixture.mean.shape[1:]
    mean, covariance = mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size)
    if rates is not None:
        expected = range_rate.expected_rates(mean, covariance, report.sensor)
        rate, variance = (part.reshape(-1, modes) for part in (expected.rate, expected.variance))
        error = rates.rate[column][:, None] - rate[row]
        return rates.model.log_density(error, variance[row] + rates.std[column][:, None] ** 2)
    if (measured := report.velocities) is not None:
        axes = list(report.sensor.space.velocity)
        gaussian, detection = gaussians_of_groups(row, modes), column.repeat(modes)
        error = measured.velocity[detection] - mean[gaussian][:, axes]
        spread = covariance[gaussian][:, axes][:, :, axes] + measured.noise[detection]
        return measured.model.log_density(error, spread).reshape(-1, modes)
    return None
