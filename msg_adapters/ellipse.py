# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The outline of a covariance."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.types import FloatArray

# Radius, in standard deviations, that holds 95 % of a two-dimensional Gaussian.
RADIUS_95 = float(np.sqrt(-2.0 * np.log(0.05)))


def outline(covariance: FloatArray, radius: float, points: int) -> FloatArray:
    """Return closed outlines about the origin, shape (..., 2, points).

    Parameters
    ----------
    covariance : array of shape (..., 2, 2)
        A negative variance, which rounding can leave, counts as zero.
    radius : float
        In standard deviations.
    points : int
        The last equals the first.
    """
    variance, axes = np.linalg.eigh(covariance)
    turn = np.linspace(0.0, 2.0 * np.pi, points)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    spread = axes * (radius * np.sqrt(np.maximum(variance, 0.0)))[..., None, :]
    line: FloatArray = spread @ circle
    line[..., -1] = line[..., 0]
    return line
