"""Detections of two targets that cross, as a table, and their truth."""

import numpy as np

# The sensor of the detections.
PARAMETERS = {
    "interval_s": 1.0,
    "radar": {"range_std": 5.0, "azimuth_std_deg": 0.5, "max_range": 1500.0, "clutter_rate": 2.0},
    "detection_births": {"std": [15.0]},
}
LAST = 40


def truth():
    """Return the truth of two targets: time, label, x, y, vx, vy."""
    time = np.arange(LAST, dtype=float)
    ways = ((1, 200.0, 100.0, 10.0, 8.0), (2, 200.0, 500.0, 10.0, -6.0))
    rows = [
        (10.0 + t, label, x + vx * t, y + vy * t, vx, vy)
        for t in time
        for label, x, y, vx, vy in ways
    ]
    return dict(zip(("time", "label", "x", "y", "vx", "vy"), np.array(rows).T, strict=True))


def detections(seed=0):
    """Return what a radar at (0, 0) sees of them, with two false detections per scan."""
    rng = np.random.default_rng(seed)
    true = truth()
    seen = rng.random(len(true["time"])) < 0.9
    distance = np.hypot(true["x"], true["y"]) + 5.0 * rng.standard_normal(len(seen))
    angle = np.arctan2(true["y"], true["x"])
    azimuth = angle + np.radians(0.5) * rng.standard_normal(len(seen))
    false = rng.poisson(2.0, LAST)
    time = np.concatenate([true["time"][seen], np.repeat(10.0 + np.arange(LAST), false)])
    clutter = rng.uniform([0.0, -np.pi], [1500.0, np.pi], (false.sum(), 2))
    order = np.argsort(time, kind="stable")
    return {
        "time": time[order],
        "range": np.concatenate([distance[seen], clutter[:, 0]])[order],
        "azimuth": np.concatenate([azimuth[seen], clutter[:, 1]])[order],
    }


def cartesian(table):
    """Return a table with positions in the place of ranges and azimuths."""
    x = table["range"] * np.cos(table["azimuth"])
    y = table["range"] * np.sin(table["azimuth"])
    return {"time": table["time"], "x": x, "y": y}
