# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""How probable it is that hypotheses are as slow as what a clutter map holds."""

from __future__ import annotations

import numpy as np
from scipy.special import chndtr

from ..arrays import FloatArray
from ..models.radar import RadarModel
from .mixture import Mixture

# Deviations of a velocity that is known well, metres per second and as a share of the bound.
LEAST_SPEED_STD, LEAST_SPEED_SHARE = 0.1, 0.05


def still(mixture: Mixture, radar: RadarModel) -> FloatArray:
    """Return how probable it is that each hypothesis is slower than `clutter_map_speed`, (H,).

    The speed of a target that has just appeared is not known, so that this is improbable. The
    ellipse of a velocity is taken as a circle of the same area.
    """
    axes, slow = list(radar.space.velocity), radar.clutter_map_speed
    covariance = mixture.covariance[..., axes, :][..., axes]
    area = np.sqrt(np.maximum(np.linalg.det(covariance), 0.0))
    variance = np.maximum(area, max(LEAST_SPEED_STD, LEAST_SPEED_SHARE * slow) ** 2)
    square = (mixture.mean[..., axes] ** 2).sum(axis=-1) / variance
    bound = slow**2 / variance
    # Beyond ten deviations it is zero, and its series would be long.
    slower = chndtr(bound, 2.0, np.minimum(square, (np.sqrt(bound) + 10.0) ** 2))
    weight = np.einsum("hrs->hr", mixture.weight)
    total = np.maximum(weight.sum(axis=1), np.finfo(float).tiny)
    probability: FloatArray = (weight * slower).sum(axis=1) / total
    return probability
