"""Gating: the detections in the gate of each hypothesis, and their approximate likelihoods."""

from __future__ import annotations

from typing import NamedTuple

from ...arrays import FloatArray, IntArray
from ...sensors.report import Report
from ...sensors.sensor import Sensor
from ..mixture import Mixture


class Expected(NamedTuple):
    """Expected measurement of each Gaussian; see `Linearised.expected`."""

    measured: FloatArray  # (H, R, Z)
    # Covariance of the expected measurement, without the sensor's noise, (H, R, Z, Z).
    covariance: FloatArray
    std: FloatArray  # Roots of its diagonal, above 0, (H, R, Z)

    @staticmethod
    def of(mixture: Mixture, sensor: Sensor) -> Expected:
        """Return the measurements that a sensor is expected to make of a mixture's Gaussians."""
        return Expected(*sensor.of_gaussians.expected(mixture.mean, mixture.covariance))


def gate_pairs(
    mixture: Mixture, expected: Expected, report: Report
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs of a hypothesis and a detection in the gate of one of its Gaussians.

    Returns
    -------
    row, column : int arrays of shape (P,)
    log_likelihood : array of shape (P, R)
        Log likelihood with the measurement linearised at the mean; -inf outside a Gaussian's gate.
        The noise is that of outliers if the sensor has any.
    """
    gaussians = mixture.mode_weight, mixture.mean, expected.measured, expected.covariance
    return report.sensor.of_gaussians.gate_pairs(*gaussians, report)
