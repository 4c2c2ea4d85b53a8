"""Targets far from each other in the beam of one radar in space, or of two without elevations."""

import numpy as np
from lone import START_NS

from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.targets.motion import sample
from phd_jdtc_ros.core.types import Detections, Scan

MOTION = list(SPATIAL.motion)
SPACE = {
    "state": "space",
    "height_prior": [1500.0, 1000.0, 0.0],
    "interval_s": 1.0,
    "accuracy": "normal",
    "detection_births.rates": [0.1],
    "detection_births.std": [20.0, 0.001, 4.0],
    "cv.vertical_noise_density": 2.0,
    "radar.position": [500.0, -300.0, 30.0],
    "radar.fields.elevation": "elevation",
    "radar.range_std": 5.0,
    "radar.azimuth_std_deg": 0.5,
    "radar.elevation_std_deg": 0.7,
    "radar.fov_elevation_deg": [-2.0, 60.0],
    "radar.detection_probability": 0.9,
    "radar.clutter_rate": 1.0,
    "radar.max_range": 2e4,
    "radar.clutter_max_range": 2e4,
}


TWO_SLANT_RANGES = {
    **SPACE,
    "sensors": ["radar", "other"],
    "radar.fields.elevation": "",
    "radar.detection_probability": 0.95,
    **{
        f"other.{name}": value
        for name, value in {
            "position": [9e3, 2e3, 10.0],
            "range_std": 5.0,
            "azimuth_std_deg": 0.5,
            "fov_elevation_deg": [-2.0, 60.0],
            "detection_probability": 0.95,
            "clutter_rate": 1.0,
            "max_range": 2e4,
            "clutter_max_range": 2e4,
        }.items()
    },
}


def scan(seconds, *reports):
    return Scan(START_NS + round(seconds * 1e9), tuple(reports))


def seen(radar, state, rng, missing=0.0):
    """Return detections of states, of which a share has no elevation."""
    measured = radar.measure(state) + radar.noise_std * rng.standard_normal((len(state), 3))
    std = np.full(measured.shape, np.nan)
    lost = rng.random(len(state)) < missing
    measured[lost, 2], std[lost, 2] = 0.0, UNKNOWN_STD
    return Detections(measured, None, noise_std=std)


def paths(config, rng, targets=40, scans=25):
    """Return the states of targets far from each other, as the motion has them, (K, T, D)."""
    (motion,) = config.model.modes.motions
    start = np.zeros((targets, len(SPATIAL)))
    angle = 2.0 * np.pi * np.arange(targets) / targets
    start[:, 0], start[:, 2] = 500.0 + 6e3 * np.cos(angle), -300.0 + 6e3 * np.sin(angle)
    start[:, 5] = rng.uniform(800.0, 2500.0, targets)
    start[:, MOTION] = rng.normal(0.0, [10.0, 10.0, 2.0], (targets, 3))
    states = [start]
    for _ in range(scans):
        states.append(sample(motion, states[-1], 1.0, rng))
    return np.array(states)


def nees(found, truth):
    """Return the squares of height errors in standard deviations, of estimates near the truth."""
    apart = np.hypot(*(found.position[:, None] - truth[:, [0, 2]]).T).T
    near = apart.argmin(axis=1)
    close = apart[np.arange(len(found)), near] < 300.0
    error = found.state[:, 5] - truth[near, 5]
    return list((error**2 / found.covariance[:, 5, 5])[close])
