"""The update of pairs of Gaussians and detections: first positions, then range rates."""

from __future__ import annotations

from typing import NamedTuple

from ...arrays import FloatArray, IntArray
from ...sensors.range_rate import Rates
from ...sensors.report import Report
from ...sensors.sensor import Sensor
from ..algebra import kalman, range_rate
from ..mixture import Mixture


class PairUpdate(NamedTuple):
    """Innovations of pairs of Gaussians and detections, leading shape (P R,).

    Parameters
    ----------
    innovation : kalman.Innovation
        Innovation of the measurement without range rate.
    rated : range_rate.Rated or None
        The Gaussians updated with range rates; None if the report has none.
    column : int array of shape (P,)
        The detection of each pair.
    """

    innovation: kalman.Innovation
    rated: range_rate.Rated | None
    column: IntArray
    report: Report

    @property
    def log_likelihood(self) -> FloatArray:
        """Log likelihood of the measurement, including any range rate, shape (P R,)."""
        if self.rated is None:
            return self.innovation.log_likelihood
        return self.innovation.log_likelihood + self.rated.log_likelihood

    def updated(
        self, mean: FloatArray, covariance: FloatArray, pair: IntArray, gaussian: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the updated Gaussians of some pairs; `gaussian` has their rows in this update."""
        if self.rated is not None:
            return self.rated.mean[gaussian], self.rated.covariance[gaussian]
        times = self.report.detections.time_s
        modes = len(gaussian) // max(len(pair), 1)
        time_s = None if times is None else times[self.column[pair]].repeat(modes)
        innovation = self.innovation.take(gaussian)
        return kalman.updated(mean, covariance, self.report.sensor, innovation, time_s)


def iterated_update(
    mixture: Mixture, row: IntArray, column: IntArray, report: Report
) -> PairUpdate:
    """Return the innovations of pairs, linearised at the posterior positions.

    Parameters
    ----------
    row, column : int arrays of shape (P,)
        Hypothesis and detection of each pair.
    """
    detections, sensor, rates = report.detections, report.sensor, report.range_rates
    modes, size = mixture.mean.shape[1:]
    mean = mixture.mean[row].reshape(-1, size)
    covariance = mixture.covariance[row].reshape(-1, size, size)
    each = column.repeat(modes)
    time_s = None if detections.time_s is None else detections.time_s[each]
    measured, noise_std = detections.measurement[each], report.detection_std[each]
    innovation = kalman.iterated_update(mean, covariance, sensor, measured, noise_std, time_s)
    rated = None
    if rates is not None:
        later = kalman.updated(mean, covariance, sensor, innovation, time_s)
        rated = range_rate.update_rates(*later, sensor, rates.take(each), time_s)
    return PairUpdate(innovation, rated, column, report)


def coarse_rates(
    mixture: Mixture, row: IntArray, column: IntArray, rates: Rates, sensor: Sensor
) -> FloatArray:
    """Return the log likelihood of the range rates of pairs at the predicted means, (P, R).

    The times of detections are ignored.
    """
    modes, size = mixture.mean.shape[1:]
    before = range_rate.expected_rates(
        mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size), sensor
    )
    rate, variance = (part.reshape(-1, modes) for part in (before.rate, before.variance))
    error = rates.rate[column][:, None] - rate[row]
    return rates.model.log_density(error, variance[row] + rates.std[column][:, None] ** 2)
