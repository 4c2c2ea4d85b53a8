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
        self, mixture: Mixture, row: IntArray, pair: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the Gaussians of hypotheses, (K, R, D) and (K, R, D, D), after their detections.

        `row` is the hypothesis before, and `pair` its pair with a detection; -1 for none.
        """
        modes, size = mixture.mean.shape[1:]
        mean, covariance = (
            mixture.mean.reshape(-1, size),
            mixture.covariance.reshape(-1, size, size),
        )
        gaussian = (row[:, None] * modes + np.arange(modes)).ravel()
        at = np.where(pair[:, None] < 0, -1, pair[:, None] * modes + np.arange(modes)).ravel()
        times = self.detections.time_s
        time_s = None if times is None else times[self.column].repeat(modes)
        if self.rated is None:
            later = kalman.updated(mean, covariance, self.radar, self.found, time_s, (gaussian, at))
        else:
            later = mean[gaussian], covariance[gaussian]
            later[0][at >= 0] = self.rated.mean[at[at >= 0]]
            later[1][at >= 0] = self.rated.covariance[at[at >= 0]]
        return later[0].reshape(-1, modes, size), later[1].reshape(-1, modes, size, size)


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
    each, own = column.repeat(modes), radar.detection_noise(detections)
    gaussian = (row[:, None] * modes + np.arange(modes)).ravel()
    mean, covariance = mixture.mean.reshape(-1, size), mixture.covariance.reshape(-1, size, size)
    found = kalman.located(
        *(mean, covariance, radar, detections.measurement),
        *(radar.noise_std if own is None else own, detections.time_s),
        # Modes without weight are left out, which are half of them.
        pairs=(np.where(mixture.mode_weight[row].ravel() > 0.0, gaussian, -1), each),
    )
    rated = None
    if rates is not None:
        time_s = None if detections.time_s is None else detections.time_s[each]
        later = kalman.updated(mean[gaussian], covariance[gaussian], radar, found, time_s)
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
