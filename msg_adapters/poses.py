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

"""The poses of the estimates of one class, written as bytes: publishers send many of them."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.motion import VX, VY, X, Y
from phd_jdtc_ros.core.types import Estimates

from . import cdr


def to_cdr(estimates: Estimates, class_id: int, frame: str) -> bytes:
    """Return a serialised ``geometry_msgs/PoseArray``; the poses face where the targets move."""
    rows = estimates.state[estimates.class_id == class_id]
    half = 0.5 * np.arctan2(rows[:, VY], rows[:, VX])
    # x y z of the position, x y z w of the orientation.
    pose = np.zeros((len(rows), 7))
    pose[:, 0], pose[:, 1] = rows[:, X], rows[:, Y]
    pose[:, 5], pose[:, 6] = np.sin(half), np.cos(half)
    writer = cdr.Writer()
    writer.header(estimates.stamp_ns, frame)
    writer.put("I", len(rows))
    if len(rows):
        writer.put("d")
    return cdr.ENCAPSULATION + bytes(writer.data) + pose.astype("<f8").tobytes()
