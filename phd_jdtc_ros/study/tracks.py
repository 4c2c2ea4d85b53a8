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

"""The truth of a run, target by target."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.motion import POSITION
from phd_jdtc_ros.core.types import FloatArray

from .record import Record


class Track(NamedTuple):
    """One target's true trajectory; `position` of shape (scans, 2) in kilometres."""

    number: int
    class_id: int
    stamp_ns: list[int]
    position: FloatArray


def true_tracks(record: Record) -> list[Track]:
    """Return the trajectories of all targets, by number."""
    rows: dict[int, list[tuple[int, int, FloatArray]]] = {}
    for truth in record.truth:
        position = truth.state[:, list(POSITION)] / 1e3
        for number, class_id, place in zip(
            truth.track_id.tolist(), truth.class_id.tolist(), position, strict=True
        ):
            rows.setdefault(number, []).append((truth.stamp_ns, class_id, place))
    return [
        Track(number, track[0][1], [t for t, _, _ in track], np.array([p for _, _, p in track]))
        for number, track in sorted(rows.items())
    ]
