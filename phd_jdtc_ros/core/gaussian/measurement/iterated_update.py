"""The update of pairs of Gaussians and detections: first positions, then range rates."""

from __future__ import annotations

from typing import NamedTuple

from ...arrays import FloatArray, IntArray
from ...sensors.of_gaussians.linearised import Measured, WeightedGaussians, gaussians_of_groups
from ...sensors.range_rate import Rates
from ...sensors.sensor import Sensor
from ...sensors.view import View
from ..algebra import heavy_tails, kalman, range_rate
from ..mixture import Mixture


class PairUpdate(NamedTuple):
    """Innovations of pairs of Gaussians and detections, leading shape (P R,)."""

    # Innovation of the measurement without range rate, with the sensor's usual noise.
    innovation: kalman.Innovation
    # `innovation`, or that of the mixture of usual noise and outliers: `heavy_tails.mix_noises`.
    matched: kalman.Innovation
    # The Gaussians updated with range rates; None if the report has none.
    rate_update: range_rate.RateUpdate | None
    # Probability that each detection is an outlier if it is the Gaussian's; None without outliers.
    outlier: FloatArray | None
    row: IntArray  # Hypothesis of each pair, (P,)
    column: IntArray  # Detection of each pair, (P,)
    report: View

    @property
    def log_likelihood(self) -> FloatArray:
        """Log likelihood of the measurement, including any range rate, shape (P R,)."""
        if self.rate_update is None:
            return self.matched.log_likelihood
        return self.matched.log_likelihood + self.rate_update.log_likelihood

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
        if self.rate_update is None:
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
            mean[detected] = self.rate_update.mean[updated[detected]]
            covariance[detected] = self.rate_update.covariance[updated[detected]]
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
    detections, sensor, rates = report.detections, report.sensor, report.range_rates
    modes, size = mixture.mean.shape[1:]
    mean, covariance = mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size)
    gaussians = WeightedGaussians.of(mean, covariance, mixture.mode_weight.reshape(-1))
    noise = report.detection_std, detections.noise_correlation
    measured = Measured(detections.measurement, *noise, detections.time_s)
    innovation = kalman.innovations(gaussians, sensor, measured, (row, column), modes)
    matched, outlier = innovation, None
    if sensor.outliers is not None:
        matched, outlier = heavy_tails.mix_noises(innovation, sensor.outliers, *noise, column)
    rate_update = None
    if rates is not None:
        gaussian, detection = gaussians_of_groups(row, modes), column.repeat(modes)
        time_s = None if detections.time_s is None else detections.time_s[detection]
        updated = kalman.update(mean[gaussian], covariance[gaussian], sensor, matched, time_s)
        rate_update = range_rate.update_rates(*updated, sensor, rates.take(detection), time_s)
    return PairUpdate(innovation, matched, rate_update, outlier, row, column, report)


def coarse_rates(
    mixture: Mixture, row: IntArray, column: IntArray, rates: Rates, sensor: Sensor
) -> FloatArray:
    """Return the log likelihood of the range rates of pairs at the predicted means, (P, R).

    The times of detections are ignored.
    """
    modes, size = mixture.mean.shape[1:]
    expected = range_rate.expected_rates(
        mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size), sensor
    )
    rate, variance = (part.reshape(-1, modes) for part in (expected.rate, expected.variance))
    error = rates.rate[column][:, None] - rate[row]
    return rates.model.log_density(error, variance[row] + rates.std[column][:, None] ** 2)
