"""Where detections put the Gaussians of their pairs: by range and azimuth, then by range rate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray, IntArray
from ...sensors.polar_radar import RadarModel, Rates
from ...types import Detections
from ..algebra import kalman, range_rate
from ..mixture import Mixture


class Located(NamedTuple):
    """What the detections of pairs make of their Gaussians, leading shape (P R,).

    Parameters
    ----------
    found : kalman.Located
        By range and azimuth.
    rated : range_rate.Rated or None
        With range rates too; None without them.
    column : int array of shape (P,)
        The detection of each pair.
    detections : Detections
    radar : RadarModel
    """

    found: kalman.Located
    rated: range_rate.Rated | None
    column: IntArray
    detections: Detections
    radar: RadarModel

    @property
    def log_likelihood(self) -> FloatArray:
        """Of range and azimuth, and of the range rate if there is one, shape (P R,)."""
        if self.rated is None:
            return self.found.log_likelihood
        return self.found.log_likelihood + self.rated.log_likelihood

    def updated(
        self, mean: FloatArray, covariance: FloatArray, pair: IntArray, gaussian: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return Gaussians after their detections; of some pairs, by row of these Gaussians."""
        if self.rated is not None:
            return self.rated.mean[gaussian], self.rated.covariance[gaussian]
        times = self.detections.time_s
        modes = len(gaussian) // max(len(pair), 1)
        return kalman.updated(
            *(mean, covariance, self.radar, self.found.take(gaussian)),
            None if times is None else times[self.column[pair]].repeat(modes),
        )


def located(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    detections: Detections,
    radar: RadarModel,
    rates: Rates | None,
) -> Located:
    """Return where the detections put the Gaussians of pairs.

    Parameters
    ----------
    mixture : Mixture
    row, column : int arrays of shape (P,)
        Hypothesis and detection of each pair.
    detections : Detections
    radar : RadarModel
    rates : Rates or None
        The detections' range rates; None without them.
    """
    modes, size = mixture.mean.shape[1:]
    mean = mixture.mean[row].reshape(-1, size)
    covariance = mixture.covariance[row].reshape(-1, size, size)
    each, own = column.repeat(modes), radar.detection_noise(detections)
    time_s = None if detections.time_s is None else detections.time_s[each]
    found = kalman.located(
        *(mean, covariance, radar, detections.measurement[each]),
        np.broadcast_to(radar.noise_std, (len(each), 2)) if own is None else own[each],
        time_s,
    )
    rated = None
    if rates is not None:
        later = kalman.updated(mean, covariance, radar, found, time_s)
        rated = range_rate.rated(*later, radar, rates.take(each), time_s)
    return Located(found, rated, column, detections, radar)


def rough_rates(
    mixture: Mixture,
    row: IntArray,
    column: IntArray,
    rates: Rates,
    radar: RadarModel,
) -> FloatArray:
    """Return about the log likelihood of the range rates of pairs, (P, R): at the predicted means.

    The times of detections are left aside.
    """
    modes, size = mixture.mean.shape[1:]
    before = range_rate.expected(
        mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size), radar
    )
    rate, variance = (part.reshape(-1, modes) for part in (before.rate, before.variance))
    error = rates.rate[column][:, None] - rate[row]
    return rates.model.log_density(error, variance[row] + rates.std[column][:, None] ** 2)
