"""Recordings of one radar's plots that the tests of `tune` share."""

import math

import numpy as np

from phd_jdtc_ros.calibration.tuning.plots import plots_of
from phd_jdtc_ros.core.types import Detections


def recorded(clouds, interval_s=2.0, times_s=None):
    """Return the plots of clouds, each of (range, azimuth) rows, at equal intervals.

    `times_s` has the plots' times after the stamp of their cloud, if they have their own.
    """
    times_s = times_s or [None] * len(clouds)
    return plots_of(
        [
            (round(number * interval_s * 1e9), Detections(np.asarray(place), None, own_s))
            for number, (place, own_s) in enumerate(zip(clouds, times_s, strict=True))
        ]
    )


def one_target(count=60, missed=(), clutter=0, seed=2):
    """Return a target that comes closer, one detection a cloud, the target's before clutter."""
    rng, clouds = np.random.default_rng(seed), []
    for cloud in range(count):
        east, north = 4000.0 - 20.0 * cloud, 3000.0 + 5.0 * cloud
        place = np.array([[math.hypot(east, north), math.atan2(north, east)]])
        place += rng.standard_normal((1, 2)) * [20.0, 0.01]
        false = np.stack([rng.uniform(0.0, 8e3, clutter), rng.uniform(-3.1, 3.1, clutter)], axis=1)
        clouds.append(np.concatenate([place[cloud in missed :], false]))
    return recorded(clouds)
