"""Outliers among a sensor's detections of targets: their noise is several times the usual one."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Outliers:
    """The noise of a measurement as a mixture of the usual and a larger one.

    The defaults describe tails as heavy as those of Student's t distribution with 3 to 5 degrees of
    freedom. Shares of 0.05 and 0.1, and ratios of 3 and 5, are as accurate.
    """

    share: float = 0.05  # Probability that a detection is an outlier
    ratio: float = 3.0  # Its standard deviations relative to the usual ones
