"""Aircraft that turn hard, seen by a radar that is less exact than it is configured to be."""

import numpy as np
from lone import lone, scan_at

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.types import UNKNOWN

PERIOD_S, AIRCRAFT, CLUTTER, RANGE = 4.0, 5, 5, 1.1e5
# True noise, where 5 m and 0.01 degrees are configured.
NOISE = np.array([25.0, np.radians(0.05)])
DETECTED, REPLIED = 0.95, 0.97
GIVEN = {
    "interval_s": PERIOD_S,
    "target.survival_probability": 0.999,
    "births": [],
    "detection_births.rates": [0.2],
    "detection_births.std": [100.0, 2e-3],
    "detection_births.least_probability": 0.005,
    "lag": 3,
    "radar.position": [0.0, 0.0],
    "radar.yaw_deg": 0.0,
    "radar.range_std": 5.0,
    "radar.azimuth_std_deg": 0.01,
    "radar.detection_probability": DETECTED,
    "radar.clutter_rate": float(CLUTTER),
    "radar.max_range": RANGE,
    "radar.clutter_max_range": RANGE,
    "cv.noise_density": 3.0,
    "existence": [0.97, 0.8],
}


def flown(rng, scans):
    """Return the positions of all aircraft by scan, (scans, AIRCRAFT, 2), and their addresses."""
    position = rng.uniform(-4e4, 4e4, (AIRCRAFT, 2))
    heading, speed = rng.uniform(-np.pi, np.pi, AIRCRAFT), rng.uniform(70.0, 250.0, AIRCRAFT)
    address = rng.choice(1 << 24, AIRCRAFT, replace=False)
    rate, left_s = np.zeros(AIRCRAFT), rng.uniform(15.0, 40.0, AIRCRAFT)
    dt, every = 0.1, []
    for _ in range(scans):
        for _ in range(round(PERIOD_S / dt)):
            ended = left_s <= 0.0
            turns = np.radians(5.0) * rng.integers(-1, 2, AIRCRAFT)
            rate, left_s = np.where(ended, turns, rate), left_s - dt
            left_s = np.where(ended, rng.uniform(10.0, 40.0, AIRCRAFT), left_s)
            heading = heading + rate * dt
            along = np.stack([np.cos(heading), np.sin(heading)], axis=1)
            position = position + dt * speed[:, None] * along
        every.append(position)
    return np.array(every), address


def measured(position, noise, rng):
    exact = np.stack([np.hypot(*position.T), np.arctan2(position[:, 1], position[:, 0])], axis=1)
    found = exact + noise * rng.standard_normal(exact.shape)
    return np.stack([found[:, 0], wrap_angle(found[:, 1])], axis=1)


def seen(position, address, rng, seconds, addresses=True, noise=NOISE):
    """Return the scan of aircraft at positions, with false detections that do not answer."""
    detected = rng.random(len(position)) < DETECTED
    shown = np.where(rng.random(len(position)) < REPLIED, address, UNKNOWN)
    plots = measured(position, noise, rng)
    false = rng.uniform([500.0, -np.pi], [RANGE, np.pi], (CLUTTER, 2))
    place = np.concatenate([plots[detected], false])
    shown = np.concatenate([shown[detected], np.full(CLUTTER, UNKNOWN)])
    return scan_at(seconds, place, **({"address": shown} if addresses else {}))


def scenes(seed, scans, addresses=True):
    """Return the true positions by scan, and the scans."""
    rng = np.random.default_rng(seed)
    truth, address = flown(rng, scans)
    found = [
        seen(position, address, rng, (index + 1) * PERIOD_S, addresses)
        for index, position in enumerate(truth)
    ]
    return truth, found


def tracker(addresses=True, given=None):
    """Return an engine for these aircraft."""
    fields = {"radar.fields.address": "address"} if addresses else {}
    return new_engine(lone({**GIVEN, **fields, **(given or {})}))
