"""Detections as Gaussians at places, the mixture of noises with outliers, and heights in space.

Heights are those of undetected targets, and those that sensors report beside a place. A transponder
reports the altitude in the standard atmosphere that has the pressure around the aircraft, in Mode C
and in ADS-B. It differs from the geometric height by some 8 m for each hPa between the pressure at
sea level and the standard one, and by the temperature; see `factors.transponder.pressure`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from scipy.special import ndtr

from ..arrays import TINY, BoolArray, FloatArray, IntArray
from ..types import Detections

# Standard deviation of the elevation of a detection without one, radians.
UNKNOWN_STD = 30.0
# Width of the uniform density of garbled heights and of heights of undetected targets, metres.
SPAN = 15e3
# Pressure at sea level in the standard atmosphere, hPa, and the height at which the pressure of its
# troposphere would be zero, metres, with the exponent of the pressure (ICAO Doc 7488).
STANDARD_HPA, TROPOSPHERE_END, EXPONENT = 1013.25, 44330.77, 0.190263
# Hypotheses of a new target's height with less than this part of its share are left out.
LEAST_SHARE = 1e-3


def noise_covariance(std: FloatArray, correlation: FloatArray | None) -> FloatArray:
    """Return covariances, (M, Z, Z), from deviations, (M, Z), and correlations, (M,) or None.

    A correlation is that of the first two components, NaN where unknown; all others are
    independent.
    """
    axis, covariance = np.arange(std.shape[1]), np.zeros((*std.shape, std.shape[1]))
    covariance[:, axis, axis] = std**2
    if correlation is not None:
        known_correlation = np.where(np.isfinite(correlation), correlation, 0.0)
        covariance[:, 0, 1] = covariance[:, 1, 0] = known_correlation * std[:, 0] * std[:, 1]
    return covariance


class PlanePlots(NamedTuple):
    """Detections as positions in the world frame, at their own times."""

    # Metres, (M, P), where P is 2, or 3 in space; see `StateSpace.place`.
    position: FloatArray
    axes: FloatArray  # Principal axes of the errors, unit vectors in columns, (M, P, P)
    std: FloatArray  # Standard deviations along these axes, metres, (M, P)

    @classmethod
    def of(cls, position: FloatArray, covariance: FloatArray) -> PlanePlots:
        """Return positions, (M, P), with these covariances, (M, P, P)."""
        variance, axes = np.linalg.eigh(covariance)
        return cls(position, axes, np.sqrt(np.maximum(variance, 0.0)))

    @property
    def root(self) -> FloatArray:
        """Square roots of the covariances, metres, shape (M, P, P)."""
        return self.axes * self.std[:, None, :]

    @property
    def covariance(self) -> FloatArray:
        """Covariances of the positions, square metres, shape (M, P, P)."""
        covariance = np.zeros_like(self.axes)
        for std, axis in zip(self.std.T, np.moveaxis(self.axes, 2, 0), strict=True):
            covariance += (std**2)[:, None, None] * axis[:, :, None] * axis[:, None, :]
        return covariance


class Births(NamedTuple):
    """Hypotheses of the places of targets that are born at detections."""

    row: IntArray  # Detection of each hypothesis, ascending, (K,)
    share: FloatArray  # Probability of each among those of its detection, (K,)
    plots: PlanePlots  # K places


class HeavyTails(Protocol):
    """The noise of a measurement as a mixture of the usual and a larger one."""

    @property
    def share(self) -> float:
        """Probability that a detection of a target has the larger noise."""

    @property
    def ratio(self) -> float:
        """Standard deviations of the larger noise relative to the usual ones."""


@dataclass(frozen=True)
class HeightPrior:
    """Heights of undetected targets: a normal distribution above a floor, metres."""

    mean: float
    std: float
    floor: float = -math.inf
    # Number of hypotheses of the height of a target born at a detection without an elevation. With
    # six the next detections select one; with more the result is the same.
    CELLS: ClassVar[int] = 6
    # Standard deviations from the mean up to which heights are considered.
    REACH: ClassVar[float] = 2.0
    FARTHEST: ClassVar[float] = 3.0  # Likewise, of targets that no sensor sees

    # Share of the deviation to which a height has to be known to be reported.
    KNOWN: ClassVar[float] = 0.5

    @property
    def top(self) -> float:
        """Height above which there are no targets outside all coverage, metres."""
        return self.mean + self.FARTHEST * self.std

    @property
    def largest_std(self) -> float:
        """Largest standard deviation of a height that is reported, metres."""
        return self.KNOWN * self.std

    def cells(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the probabilities, (K, M), and the centres of cells between heights, and widths.

        The cells divide the heights that are considered and within the bounds, (M,), evenly. If
        there are none, they divide what is within the bounds, with equal probabilities.
        """
        reach = self.REACH * self.std
        bottom = np.maximum(low, max(self.mean - reach, self.floor))
        top = np.minimum(high, self.mean + reach)
        elsewhere = bottom >= top
        bottom, top = np.where(elsewhere, low, bottom), np.where(elsewhere, high, top)
        width = (top - bottom) / self.CELLS
        edges = bottom + np.arange(self.CELLS + 1)[:, None] * width
        mass = np.where(elsewhere, 1.0, np.diff(ndtr((edges - self.mean) / self.std), axis=0))
        share: FloatArray = mass / mass.sum(axis=0)
        return share, edges[:-1] + 0.5 * width, width


@dataclass(frozen=True)
class ReportedHeights:
    """The errors of the heights that a sensor reports."""

    # Standard deviation of a height without its own, metres: Mode C has steps of 100 ft.
    std: float = 7.6
    garbled: float = 0.01  # Probability that a height is garbled: it is then uniform
    pressure: bool = False  # Whether they are pressure altitudes
    # Interval in which heights of undetected targets, of clutter and garbled ones are uniform, m.
    span: float = SPAN

    def of(self, detections: Detections) -> Heights | None:
        """Return the heights of detections; None without any."""
        height, std = detections.z, detections.z_std
        if height is None or not np.isfinite(height).any():
            return None
        own = np.full(len(height), self.std)
        own = own if std is None else np.where(np.isfinite(std), std, own)
        return Heights(self.garbled, height, own, self.span)


class Air(NamedTuple):
    """What is known of the pressure altitudes of targets before any detection."""

    above: float = 0.0  # Expected difference from their heights, metres
    std: float = 0.0  # Standard deviation of this difference, metres

    @staticmethod
    def of(qnh_hpa: float, std_hpa: float) -> Air:
        """Return what a pressure at sea level and its deviation show."""
        relative = (qnh_hpa / STANDARD_HPA) ** EXPONENT
        metres = EXPONENT * TROPOSPHERE_END * relative / qnh_hpa * std_hpa
        return Air(TROPOSPHERE_END * (1.0 - relative), metres)


STANDARD_AIR = Air()


class Heights(NamedTuple):
    """Heights of M detections."""

    garbled: float  # See `ReportedHeights`
    height: FloatArray  # Metres, NaN where unknown, (M,)
    std: FloatArray  # Standard deviations, metres, (M,)
    span: float = SPAN  # See `ReportedHeights`

    @property
    def is_known(self) -> BoolArray:
        """Mask of the known heights, (M,)."""
        return np.isfinite(self.height)

    def take(self, rows: IntArray) -> Heights:
        """Return the heights of these detections."""
        return Heights(self.garbled, self.height[rows], self.std[rows], self.span)

    def compare(self, mean: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the log likelihood of heights, and the probability that each is not garbled.

        `mean` and `variance` are those of the targets' heights, (M, ...). The likelihood is that
        relative to undetected targets and clutter, whose heights are uniform: 1 if it is unknown.
        """
        lacking = tuple(range(1, mean.ndim))
        height, std = (np.expand_dims(each, lacking) for each in (self.height, self.std))
        known, total = np.isfinite(height), variance + std**2
        error = np.where(known, height, mean) - mean
        density = np.exp(-0.5 * error**2 / total) / np.sqrt(2.0 * np.pi * total)
        true = (1.0 - self.garbled) * self.span * density
        likelihood = np.maximum(true + self.garbled, TINY)
        log_likelihood = np.where(known, np.log(likelihood), 0.0)
        return log_likelihood, np.where(known, true / likelihood, 0.0)

    def divide(self, births: Births) -> Births:
        """Return births, of which those with a known height are two: measured, and garbled.

        Hypotheses with less than `LEAST_SHARE` of their share are left out.
        """
        place, covariance = births.plots.position, births.plots.covariance
        own = self.take(births.row)
        _, true = own.compare(place[:, 2], covariance[:, 2, 2])
        gain = covariance[:, :, 2] / (covariance[:, 2, 2] + own.std**2)[:, None]
        error = np.where(own.is_known, own.height - place[:, 2], 0.0)
        reduced = covariance - gain[:, :, None] * covariance[:, None, :, 2]
        measured = PlanePlots.of(place + gain * error[:, None], reduced)
        plots = [np.concatenate(pair) for pair in zip(measured, births.plots, strict=True)]
        share = np.concatenate([true, 1.0 - true])
        kept = np.flatnonzero(share >= LEAST_SHARE)
        row, share = np.tile(births.row, 2)[kept], (share * np.tile(births.share, 2))[kept]
        order = np.argsort(row, kind="stable")
        columns = (column[kept][order] for column in plots)
        return Births(row[order], share[order], PlanePlots(*columns))
