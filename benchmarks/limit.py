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

"""The work that no search is without: to whiten both sets, sort one and gather it."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.model import TrackerModel
from phd_jdtc_ros.core.motion import whitener
from phd_jdtc_ros.core.types import FloatArray, ParticlePHD


def whiten_sort_gather(
    earlier: ParticlePHD, later: ParticlePHD, model: TrackerModel, dt: float
) -> list[FloatArray]:
    """Whiten for every destination mode, sort by one coordinate, gather; nothing is searched."""
    gathered = []
    transition = model.modes.transition(dt)
    for mode, motion in enumerate(model.modes.motions):
        matrix, _ = whitener(motion.noise_covariance(dt))
        support = list(motion.support)
        sources = np.flatnonzero(transition[earlier.mode, mode] > 0.0)
        successor = motion.mean(earlier.state[sources], dt)[:, support] @ matrix.T
        states = later.state[later.mode == mode][:, support] @ matrix.T
        for points in (successor, states):
            order = np.argsort(points[:, 0], kind="stable")
            gathered.append(points[order])
    return gathered
