"""A ship that goes in a circle and turns, its radar, and what the radar sees."""

import numpy as np

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import flatten
from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.types import Detections, Pose

START_NS = 1_700_000_000 * 10**9
INTERVAL_S, SCANS = 2.0, 20
# East, north and velocities at the start: boats that go straight on.
BOATS = np.array([[700.0, 300.0, -6.0, 2.0], [-500.0, 600.0, 4.0, -5.0]])
CLUTTER = 3
# Position and yaw of the antenna on the ship.
MOUNT = (10.0, -3.0), 0.5
SPEED, TURN_RATE = 10.0, 0.05
ODOMETRY = "/own_ship/odometry"

PARAMETERS = {
    "sensors": ["mast"],
    "interval_s": INTERVAL_S,
    "lag": 3,
    "classes": ["boat"],
    "motions": ["cv"],
    "births": [],
    "detection_births": {"rates": [0.1], "std": [8.0]},
    "spawn": {"rate": 0.0},
    "boat": {"motions": ["cv"], "mode_transition": [1.0], "snr_band_db": [10.0, 30.0]},
    "cv": {"noise_density": 0.05},
    "mast": {
        "fields": {"amplitude": ""},
        "pose": ODOMETRY,
        "position": list(MOUNT[0]),
        "yaw_deg": float(np.degrees(MOUNT[1])),
        "detection_probability": 0.95,
        "range_std": 5.0,
        "azimuth_std_deg": 0.5,
        "max_range": 2000.0,
        "clutter_rate": float(CLUTTER),
        "clutter_max_range": 2000.0,
    },
}


def config(**changes):
    return resolve({**dict(flatten(PARAMETERS)), **changes})


def ship(time_s):
    """Return the ship's pose: it begins at the origin, goes east and turns to the left."""
    yaw = TURN_RATE * time_s
    radius = SPEED / TURN_RATE
    return Pose((radius * np.sin(yaw), radius * (1.0 - np.cos(yaw))), float(wrap_angle(yaw)))


def antenna(time_s):
    """Return the antenna's place and direction."""
    pose, (ahead, left), turn = ship(time_s), *MOUNT
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    offset = np.array([cos * ahead - sin * left, sin * ahead + cos * left])
    return pose.position + offset, pose.yaw + turn


def boats(time_s):
    return BOATS[:, :2] + time_s * BOATS[:, 2:]


def stamp(time_s):
    return START_NS + round(time_s * 1e9)


def scan(index, rng):
    """Return what the radar sees of the boats and of clutter in a scan."""
    place, turn = antenna(index * INTERVAL_S)
    line = boats(index * INTERVAL_S) - place
    seen = np.stack([np.hypot(*line.T), np.arctan2(line[:, 1], line[:, 0]) - turn], axis=1)
    seen += rng.standard_normal(seen.shape) * [5.0, np.radians(0.5)]
    false = rng.uniform([50.0, -np.pi], [2000.0, np.pi], (CLUTTER, 2))
    measurement = np.concatenate([seen, false])
    measurement[:, 1] = wrap_angle(measurement[:, 1])
    return Detections(measurement, None)


def scans(count=SCANS, seed=1):
    rng = np.random.default_rng(seed)
    return [scan(index, rng) for index in range(count)]


def errors(estimates, since=6):
    """Return how far each boat is from the nearest estimate in every scan, metres."""
    found = []
    for filtered in estimates:
        index = round((filtered.stamp_ns - START_NS) * 1e-9 / INTERVAL_S)
        if index >= since:
            away = boats(index * INTERVAL_S)[:, None] - filtered.position[None]
            found.append(np.hypot(*np.moveaxis(away, 2, 0)).min(axis=1, initial=np.inf))
    return np.array(found)
