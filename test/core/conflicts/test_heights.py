"""Possible heights of targets in the plane, and what they are for conflicts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.core.conflicts.model import ConflictModel, LevelFlight
from phd_jdtc_ros.core.conflicts.watch import Watch
from phd_jdtc_ros.core.engine import Paths
from phd_jdtc_ros.core.tracks.manual import Manual
from phd_jdtc_ros.core.types import CONFIRMED, UNKNOWN, Attributes, Estimates

COUNT, POINTS, INTERVAL_S = 4000, 25, 10.0


def paths(*rows, std=0.0, age_s=0.0, model=None):
    """Return the heights of targets with these heights and climb rates."""
    height = np.array(rows, dtype=float)
    covariance = np.tile(np.diag([std**2, 0.0]), (len(rows), 1, 1))
    covariance[np.isnan(height[:, 0])] = np.nan
    none = np.full(len(rows), UNKNOWN)
    known = Attributes(height, covariance, none, none)
    rng = np.random.default_rng(3)
    return (model or LevelFlight()).paths(known, age_s, INTERVAL_S, (COUNT, POINTS), rng)


def test_level_aircraft_keep_their_level_for_the_time_of_the_model():
    model = LevelFlight()
    (found,) = paths((3000.0, 0.4), model=model)
    kept = (found == 3000.0).mean(axis=0)
    expected = np.exp(-INTERVAL_S * np.maximum(np.arange(POINTS) - 1, 0) / model.level_s)
    assert kept == pytest.approx(expected, abs=0.02)
    assert found[:, -1].mean() == pytest.approx(3000.0, abs=30.0)


def test_climbing_aircraft_climb_on_and_level_off():
    model = LevelFlight()
    (found,) = paths((1000.0, 10.0), std=20.0, age_s=5.0, model=model)
    assert found[:, 0].mean() == pytest.approx(1050.0, abs=1.5)
    assert found[:, 0].std() == pytest.approx(20.0, rel=0.05)
    # The mean of the time until an exponential end, within the length of the paths.
    span_s = INTERVAL_S * (POINTS - 1)
    climbing_s = model.climb_s * -math.expm1(-span_s / model.climb_s)
    assert (found[:, -1] - found[:, 0]).mean() == pytest.approx(10.0 * climbing_s, rel=0.04)
    assert (np.diff(found)[:, -1] == 0.0).mean() == pytest.approx(
        1.0 - math.exp(-(span_s - INTERVAL_S) / model.climb_s), abs=0.12
    )


def test_unknown_heights_stay_unknown_beside_known_ones():
    unknown, known = paths((math.nan, math.nan), (500.0, 0.0))
    assert np.isnan(unknown).all()
    assert np.isfinite(known).all()


class Flying:
    """An engine whose targets fly side by side, 100 m apart, without heights."""

    def paths(self, tracks, interval_s, steps, count, rng):
        place = np.full((len(tracks), count, steps + 1, 3), np.nan)
        place[..., 0] = 200.0 * interval_s * np.arange(steps + 1)
        place[..., 1] = 100.0 * np.arange(len(tracks))[:, None, None]
        return Paths(tracks, place)


@pytest.mark.parametrize(
    ("heights", "height", "least", "most"),
    [
        ((3000.0, 9000.0), 300.0, 0.0, 0.01),
        ((3000.0, 9000.0), 0.0, 0.99, 1.0),
        ((3000.0, 3200.0), 300.0, 0.99, 1.0),
        ((3000.0, math.nan), 300.0, 0.99, 1.0),
        # One of them will perhaps climb through the other's level.
        ((3000.0, 3400.0), 300.0, 0.02, 0.5),
    ],
)
def test_watch_takes_reported_heights_into_account(heights, height, least, most):
    known = Attributes.unknown(2)
    motion = np.array([[each, 0.0] for each in heights])
    spread = np.where(np.isnan(motion[:, :1, None]), np.nan, np.diag([100.0, 0.01]))
    known = known.changed(height=motion, height_covariance=spread)
    found = replace(Estimates.empty(10**9, 0, 1).changed(**two_targets()), attributes=known)
    watch = Watch(ConflictModel(distance=500.0, height=height, horizon_s=120.0))
    conflicts, _ = watch.step(10**9, [found], Flying(), None, Manual())
    probability = conflicts.probability.max(initial=0.0)
    assert least <= probability <= most


def two_targets():
    """Return the columns of two confirmed estimates."""
    return {
        "state": np.zeros((2, 5)),
        "covariance": np.zeros((2, 5, 5)),
        "weight": np.ones(2),
        "class_probability": np.ones((2, 1)),
        "class_id": np.zeros(2, dtype=np.int64),
        "track_id": np.array([1, 2]),
        "track_state": np.full(2, CONFIRMED),
    }
