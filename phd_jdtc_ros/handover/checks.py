"""Checks whether estimates can be joined with other trackers' estimates."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.types import Estimates

# Largest number of targets of one stamp, which bounds work and memory.
MOST_TARGETS = 10_000
# FLOAT32 rounding does not make an eigenvalue of a correlation matrix smaller than this.
ROUNDING = -1e-6
# Matching adds this to each axis; half of it belongs to each estimate.
_SLACK = 0.5


def fault_of(found: Estimates) -> tuple[str, str] | None:
    """Return why estimates cannot be joined, as a key and a sentence; None if they can.

    Tracks must have unique numbers. Covariances of position and velocity must be positive
    semidefinite, because a distance between two estimates is undefined otherwise. There may be at
    most `MOST_TARGETS` of them.
    """
    if len(found) > MOST_TARGETS:
        return "oversize", f"{len(found)} targets, at most {MOST_TARGETS} are allowed"
    tracks, counts = np.unique(found.track_id, return_counts=True)
    if (tracks <= 0).any():
        count = int(counts[tracks <= 0].sum())
        return "unlabelled", (
            f"{count} of {len(found)} targets have track_id 0, must be above 0: a tracker with "
            "engine: phd has no tracks"
        )
    if (counts > 1).any():
        return "schema", f"track_id {tracks[counts > 1][0]} is given twice, must be once"
    axes = [*found.space.position, *found.space.velocity]
    covariance = found.covariance[:, axes][:, :, axes]
    variance = np.einsum("tii->ti", covariance)
    lowest = np.full(len(found), -np.inf)
    usable = (variance >= 0.0).all(axis=1)
    scale = np.sqrt(variance[usable] + _SLACK)
    whole = covariance[usable] + _SLACK * np.eye(len(axes))
    lowest[usable] = np.linalg.eigvalsh(whole / (scale[:, :, None] * scale[:, None]))[:, 0]
    bad = np.flatnonzero(lowest < ROUNDING)
    if len(bad):
        return "covariance", (
            f"the covariance of track {found.track_id[bad[0]]} has a negative eigenvalue, must be "
            "positive semidefinite"
        )
    return None
