# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Rauch-Tung-Striebel smoother of one Gaussian track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from .ekf import Gaussian


@dataclass(frozen=True)
class Filtered:
    """The filter's result for one scan, as the smoother needs it.

    Parameters
    ----------
    transition : array of shape (D, D)
        F from the previous scan.
    predicted : Gaussian
        Before the scan's measurements; the prior on a target's first scan.
    updated : Gaussian
        After the scan's measurements.
    """

    transition: FloatArray
    predicted: Gaussian
    updated: Gaussian


def smooth(filtered: Sequence[Filtered]) -> Gaussian:
    """Return the first scan's distribution given the measurements of all of them.

    Parameters
    ----------
    filtered : sequence of Filtered
        Consecutive scans of one target; for a single scan its filtered distribution is returned.

    References
    ----------
    Rauch, Tung and Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA
    Journal 3(8), 1965.
    """
    later = filtered[-1].updated
    for here, ahead in zip(filtered[-2::-1], filtered[:0:-1], strict=True):
        # G = P F' P_predicted^-1
        gain = np.linalg.solve(
            ahead.predicted.covariance, ahead.transition @ here.updated.covariance
        ).T
        correction = later.covariance - ahead.predicted.covariance
        later = Gaussian(
            here.updated.mean + gain @ (later.mean - ahead.predicted.mean),
            here.updated.covariance + gain @ correction @ gain.T,
        )
    return later
