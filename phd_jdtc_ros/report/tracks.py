"""The true trajectories of a run, by target."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from .record import Record


class Track(NamedTuple):
    """One target's true trajectory; `position` of shape (scans, 2) in metres."""

    number: int
    class_id: int
    stamp_ns: list[int]
    position: FloatArray


def true_tracks(record: Record) -> list[Track]:
    """Return the trajectories of all targets, by number."""
    rows: dict[int, list[tuple[int, int, FloatArray]]] = {}
    for truth in record.truth:
        for number, class_id, place in zip(
            truth.track_id.tolist(), truth.class_id.tolist(), truth.position, strict=True
        ):
            rows.setdefault(number, []).append((truth.stamp_ns, class_id, place))
    return [
        Track(number, track[0][1], [t for t, _, _ in track], np.array([p for _, _, p in track]))
        for number, track in sorted(rows.items())
    ]
