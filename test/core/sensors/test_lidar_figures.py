"""Accuracy with a sensor of positions: eight objects amid false detections, ten scans a second.

Each detection has a covariance of its own, 0.1 to 0.4 m along the sensor's axes with correlations
of either sign, and in one case a velocity.
"""

import numpy as np
import pytest

from phd_jdtc_ros import Tracker, evaluate

SCANS, OBJECTS, SPEED_STD = 400, 8, 0.3
TIMES = 0.1 * np.arange(SCANS)
MIDDLE, HALF = np.array([50.0, 30.0]), np.array([45.0, 25.0])
TRACKER = {
    "interval_s": 0.1,
    "motions": ["cv", "ct"],
    "target": {"motions": ["cv", "ct"], "mode_transition": [0.95, 0.05, 0.1, 0.9]},
    "cv.noise_density": 0.2,
    "ct.model": "coordinated_turn",
    "ct.noise_density": 0.5,
    "ct.turn_noise_density": 0.02,
    "lag": 5,
    "detection_births": {"rates": [0.02], "std": [5.0, 0.2]},
    "radar": {
        "kind": "position",
        "position_std": 0.25,
        "velocity_std": SPEED_STD,
        "area": [-1.0, -1.0, 101.0, 61.0],
        "clutter_rate": 3.0,
        "detection_probability": 0.95,
    },
}


def paths(rng):
    """Return places and velocities, (SCANS, OBJECTS, 2): walkers and riders who turn at times."""
    place = rng.uniform(MIDDLE - HALF, MIDDLE + HALF, (OBJECTS, 2))
    speed, heading = rng.uniform(0.8, 5.0, OBJECTS), rng.uniform(-np.pi, np.pi, OBJECTS)
    turn, places, velocities = np.zeros(OBJECTS), [], []
    for _ in TIMES:
        turn = np.where(rng.random(OBJECTS) < 0.01, rng.choice([0.0, 0.25, -0.25], OBJECTS), turn)
        # Back towards the middle near the edges.
        inward = np.arctan2(*(MIDDLE - place).T[::-1])
        off = np.mod(inward - heading + np.pi, 2.0 * np.pi) - np.pi
        outside = (np.abs(place - MIDDLE) > HALF - 6.0).any(axis=1) & (np.abs(off) > 0.8)
        heading = heading + 0.1 * np.where(outside, 0.8 * np.sign(off), turn)
        velocity = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        place = place + 0.1 * velocity
        places.append(place)
        velocities.append(velocity)
    return np.array(places), np.array(velocities)


def detections(rng, places, velocities):
    """Return the table of all scans, with velocities."""
    rows = []
    for time, place, velocity in zip(TIMES, places, velocities, strict=True):
        seen, false = rng.random(OBJECTS) < 0.95, rng.poisson(3)
        true = np.concatenate([place[seen], rng.uniform([0.0, 0.0], [100.0, 60.0], (false, 2))])
        std, correlation = rng.uniform(0.1, 0.4, true.shape), rng.uniform(-0.8, 0.8, len(true))
        error = rng.standard_normal(true.shape)
        error[:, 1] = correlation * error[:, 0] + np.sqrt(1.0 - correlation**2) * error[:, 1]
        speeds = np.concatenate([velocity[seen], rng.uniform(-10.0, 10.0, (false, 2))])
        speeds += SPEED_STD * rng.standard_normal(speeds.shape)
        columns = (np.full(len(true), time), true + std * error, std, correlation, speeds)
        rows.append(np.column_stack(columns))
    names = ("time", "x", "y", "x_std", "y_std", "correlation", "vx", "vy")
    return dict(zip(names, np.concatenate(rows).T, strict=True))


@pytest.mark.parametrize(("velocity", "most"), [(False, 0.17), (True, 0.11)])
def test_objects_are_located_as_well_as_their_covariances_allow(velocity, most):
    squares, nees = [], []
    for seed in (301, 302, 303):
        rng = np.random.default_rng(seed)
        places, velocities = paths(rng)
        table = detections(rng, places, velocities)
        if not velocity:
            table = {name: column for name, column in table.items() if name not in ("vx", "vy")}
        found = Tracker(TRACKER).track(table).filtered
        label = np.broadcast_to(np.arange(OBJECTS), places.shape[:2])
        truth = {
            "time": np.repeat(TIMES, OBJECTS),
            "label": label.ravel(),
            "x": places[..., 0].ravel(),
            "y": places[..., 1].ravel(),
        }
        scores = evaluate(truth, found, cutoff=1.5, times=TIMES)
        assert scores["identity_switches"] == 0
        assert scores["missed"] < 0.01 * OBJECTS
        assert scores["false"] < 0.05
        squares.append(scores["position_rms"] ** 2)
        index = np.rint(found["time"] * 10.0).astype(int)
        off = np.stack([found["x"], found["y"]], axis=1)[:, None] - places[index]
        nearest = (off**2).sum(axis=2).argmin(axis=1)
        own = off[np.arange(len(off)), nearest]
        covariance = found["covariance"][:, :2, :2]
        each = (own * np.linalg.solve(covariance, own[..., None])[..., 0]).sum(axis=1) / 2.0
        nees.append(each[np.hypot(*own.T) < 1.5].mean())
    assert np.sqrt(np.mean(squares)) <= most
    assert 0.9 < np.mean(nees) < 1.2
