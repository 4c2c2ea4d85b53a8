"""States and estimates with usual values of whatever a test does not care about."""

import numpy as np

from phd_jdtc_ros.core.types import Estimates


def states(position, velocity=(0.0, 0.0), turn_rate=0.0):
    """Return the states, (T, 5), at positions, (T, 2); a velocity may be that of all of them."""
    position = np.reshape(position, (-1, 2))
    found = np.zeros((len(position), 5))
    found[:, [0, 2]], found[:, [1, 3]], found[:, 4] = position, velocity, turn_rate
    return found


def estimates(state, covariance=None, weight=1.0, **parts):
    """Return estimates of states, (T, 5), of one class and without tracks unless `parts` has them.

    The covariance, (5, 5), and the weight are those of all of them.
    """
    count = len(state)
    usual = {
        "stamp_ns": 0,
        "lag": 0,
        "class_probability": np.ones((count, 1)),
        "class_id": np.zeros(count, dtype=np.int64),
        "track_id": np.zeros(count, dtype=np.int64),
    }
    covariance = np.tile(np.eye(5) if covariance is None else covariance, (count, 1, 1))
    return Estimates(
        state=state, covariance=covariance, weight=np.full(count, weight), **{**usual, **parts}
    )


def of_tracks(tracks, velocity=(0.0, 0.0), variance=(2500.0, 1.0, 2500.0, 1.0, 1e-6), **parts):
    """Return estimates of tracks, each its place by its number."""
    state = states([*tracks.values()], velocity)
    number = np.array([*tracks], dtype=np.int64)
    return estimates(state, np.diag(variance), track_id=number, **parts)
