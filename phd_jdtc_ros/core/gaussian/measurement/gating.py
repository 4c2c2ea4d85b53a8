"""Gating: the detections in the gate of each hypothesis, and their approximate likelihoods."""

from __future__ import annotations

from ...arrays import FloatArray, IntArray
from ...sensors.of_gaussians.linearised import Expected
from ...sensors.view import View
from ..mixture import Mixture


def gate_pairs(
    mixture: Mixture, expected: Expected, report: View
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs of a hypothesis and a detection in the gate of one of its Gaussians.

    Returns
    -------
    row, column : int arrays of shape (P,)
    log_likelihood : array of shape (P, R)
        Log likelihood with the measurement linearised at the mean; -inf outside a Gaussian's gate.
        The noise is that of outliers if the sensor has any.
    """
    gaussians = report.sensor.of_gaussians
    return gaussians.gate_pairs(mixture.sums.mode_weight, mixture.mean, expected, report)
