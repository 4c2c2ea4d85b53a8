# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""How probable it is that hypotheses are as slow as what a clutter map holds."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..models import rest
from ..models.radar import RadarModel
from .mixture import Mixture


def slow(mixture: Mixture, radar: RadarModel) -> FloatArray:
    """Return how probable it is that each hypothesis is slower than `clutter_map_speed`, (H,)."""
    axes = list(radar.space.velocity)
    covariance = mixture.covariance[..., axes, :][..., axes]
    slower = rest.slower(mixture.mean[..., axes], covariance, radar.clutter_map_speed)
    weight = np.einsum("hrs->hr", mixture.weight)
    total = np.maximum(weight.sum(axis=1), np.finfo(float).tiny)
    probability: FloatArray = (weight * slower).sum(axis=1) / total
    return probability
