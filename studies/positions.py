"""How well people and vehicles are tracked from the places that a lidar reports, in random traffic.

Eight objects for a minute at 10 Hz, with false detections among them. The same detections are
tracked as places, as places with velocities, and in space with heights and climb rates, by the
parameters of ``config/lidar.yaml`` with the sensor's pose, area and data sheet.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from phd_jdtc_ros import Tracker, evaluate, resources
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.parameter_files import from_arguments

from .runner import Figures, Goal, Study, cell, goal, table

INTERVAL_S, SCANS, OBJECTS = 0.1, 600, 8
# Size of the scene, metres, and place and direction of the lidar in it.
SIDES, PLACE, YAW_DEG = np.array([100.0, 60.0]), np.array([20.0, -10.0]), 30.0
DETECTION_PROBABILITY, FALSE = 0.95, 3.0
# Bounds of the deviations of a detection along each axis, metres, and of their correlation.
LEAST_STD, MOST_STD, MOST_CORRELATION, Z_STD = 0.1, 0.4, 0.8, 0.2
VELOCITY_STD, CLIMB_STD = 0.3, 0.3
GATE = 1.5  # Metres within which a track is an object's
SETTLED_S = 2.0  # Scans before this do not count
FIGURES = {
    "found": ".1f",
    "rms": ".3f",
    "velocity rms": ".2f",
    "height rms": ".2f",
    "nees": ".2f",
    "switches": ".1f",
    "false": ".3f",
}
COLUMNS = ("time", "x", "y", "x_std", "y_std", "correlation")
MOVING = (*COLUMNS, "vx", "vy")
TRACKERS: Mapping[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "places": (COLUMNS, {}),
    "places and velocities": (MOVING, {}),
    "in space": (
        (*MOVING, "vz", "z", "z_std"),
        {"state": "space", "height_prior": [2.0, 3.0, -2.0], "lidar.fields.z": "z"},
    ),
}


class Scene(NamedTuple):
    """Truth of each scan and object, (S, N, 3), metres and metres per second, and detections."""

    places: FloatArray
    velocities: FloatArray
    detections: dict[str, FloatArray]


def scene(seed: int) -> Scene:
    """Return objects that turn within the scene, and what the lidar reports."""
    rng = np.random.default_rng([seed, 11])
    place = rng.uniform(0.1, 0.9, (OBJECTS, 2)) * SIDES
    course, usual = rng.uniform(-np.pi, np.pi, OBJECTS), rng.uniform(0.8, 5.0, OBJECTS)
    phase, turn = rng.uniform(-np.pi, np.pi, OBJECTS), np.zeros(OBJECTS)
    places, velocities = np.empty((SCANS, OBJECTS, 3)), np.empty((SCANS, OBJECTS, 3))
    for scan in range(SCANS):
        turn = np.where(rng.random(OBJECTS) < 0.01, rng.choice([0.0, 0.25, -0.25], OBJECTS), turn)
        # Near the edges they turn until they head for the middle, give or take 45 degrees.
        to_middle = 0.5 * SIDES - place
        ahead = np.cos(course) * to_middle[:, 0] + np.sin(course) * to_middle[:, 1]
        side = np.sign(np.cos(course) * to_middle[:, 1] - np.sin(course) * to_middle[:, 0])
        away = ahead < 0.7 * np.hypot(*to_middle.T)
        outside = away & (np.abs(to_middle) > 0.5 * SIDES - 10.0).any(axis=1)
        course = course + INTERVAL_S * np.where(outside, 0.8 * side, turn)
        velocity = usual[:, None] * np.stack([np.cos(course), np.sin(course)], axis=1)
        place = place + INTERVAL_S * velocity
        rise = 0.2 * np.pi * INTERVAL_S * scan + phase
        places[scan, :, :2], places[scan, :, 2] = place, 1.5 + 0.5 * np.sin(rise)
        velocities[scan, :, :2] = velocity
        velocities[scan, :, 2] = 0.1 * np.pi * np.cos(rise)
    return Scene(places, velocities, _detections(rng, places, velocities))


def _detections(
    rng: np.random.Generator, places: FloatArray, velocities: FloatArray
) -> dict[str, FloatArray]:
    """Return the columns of all detections, in the lidar's frame."""
    cos, sin = np.cos(np.radians(YAW_DEG)), np.sin(np.radians(YAW_DEG))
    to_sensor = np.array([[cos, sin], [-sin, cos]])
    parts = []
    for scan in range(SCANS):
        seen, false = rng.random(OBJECTS) < DETECTION_PROBABILITY, rng.poisson(FALSE)
        clutter = rng.uniform([0.0, 0.0, 0.0], [*SIDES, 3.0], (false, 3))
        place = np.concatenate([places[scan, seen], clutter])
        drift = rng.uniform([-10.0, -10.0, -1.0], [10.0, 10.0, 1.0], (false, 3))
        velocity = np.concatenate([velocities[scan, seen], drift])
        count = len(place)
        std = rng.uniform(LEAST_STD, MOST_STD, (count, 2))
        correlation = rng.uniform(-MOST_CORRELATION, MOST_CORRELATION, count)
        error, up, noise = (rng.standard_normal((count, size)) for size in (2, 1, 3))
        error[:, 1] = correlation * error[:, 0] + np.sqrt(1.0 - correlation**2) * error[:, 1]
        level = (place[:, :2] - PLACE) @ to_sensor.T + std * error
        moving = velocity[:, :2] @ to_sensor.T + VELOCITY_STD * noise[:, :2]
        own = (
            *(np.full(count, scan * INTERVAL_S), *level.T, *std.T, correlation, *moving.T),
            *(velocity[:, 2] + CLIMB_STD * noise[:, 2], place[:, 2] + Z_STD * up[:, 0]),
            np.full(count, Z_STD),
        )
        parts.append(np.stack(own)[:, rng.permutation(count)])
    return dict(zip((*MOVING, "vz", "z", "z_std"), np.concatenate(parts, axis=1), strict=True))


def _parameters(more: Mapping[str, Any]) -> dict[str, Any]:
    """Return the profile's parameters for this lidar."""
    given = from_arguments.load(resources.find(Path("config/lidar.yaml")))
    return {
        **given,
        "lidar.position": [*PLACE.tolist(), 0.0],
        "lidar.yaw_deg": YAW_DEG,
        "lidar.area": [-30.0, -60.0, 120.0, 90.0],
        "lidar.velocity_std": VELOCITY_STD,
        **more,
    }


def measure(_: argparse.Namespace, seed: int) -> Figures:
    """Return the scores of a seed by tracker and source."""
    made = scene(seed)
    times = INTERVAL_S * np.arange(SCANS)
    count = SCANS * OBJECTS
    truth = {"time": times.repeat(OBJECTS), "label": np.tile(np.arange(1, OBJECTS + 1), SCANS)}
    truth |= dict(zip(("x", "y", "height"), made.places.reshape(count, 3).T, strict=True))
    truth |= dict(zip(("vx", "vy"), made.velocities.reshape(count, 3).T, strict=False))
    found: Figures = {}
    for name, (columns, more) in TRACKERS.items():
        table = {column: made.detections[column] for column in columns}
        tracks = Tracker(_parameters(more)).track(table)
        sources = {"filtered": tracks.filtered, "smoothed": tracks.smoothed}
        found[name] = {what: _score(made, truth, own) for what, own in sources.items()}
    return found


def _score(made: Scene, truth: Mapping[str, Any], tracks: Any) -> Figures:
    """Return the scores of tracks; missed objects are in percent, false tracks per scan."""
    kept = truth["time"] >= SETTLED_S
    tracks = tracks[tracks["time"] >= SETTLED_S - 1e-6]
    times = np.unique(truth["time"][kept])
    scores = evaluate(
        {name: column[kept] for name, column in truth.items()}, tracks, cutoff=GATE, times=times
    )
    scan = np.rint(tracks["time"] / INTERVAL_S).astype(np.int64)
    apart = made.places[scan, :, :2] - np.stack([tracks["x"], tracks["y"]], axis=1)[:, None]
    distance = np.linalg.norm(apart, axis=2)
    nearest, rows = distance.argmin(axis=1), np.arange(len(tracks))
    near = distance[rows, nearest] < GATE
    velocity = np.stack([tracks["vx"], tracks["vy"]], axis=1)
    error = (velocity - made.velocities[scan, nearest, :2])[near]
    return {
        "found": 100.0 * (1.0 - scores["missed"] / OBJECTS),
        "rms": scores["position_rms"],
        "velocity rms": float(np.sqrt((error**2).sum(axis=1).mean())),
        "height rms": scores["height_rms"],
        "nees": scores["nees"],
        "switches": scores["identity_switches"],
        "false": scores["false_per_scan"],
    }


def goals(figures: Figures) -> list[Goal]:
    """Return the goals of the filtered tracks."""
    places, moving = (figures[name]["filtered"] for name in list(TRACKERS)[:2])
    return [
        goal("lidar: RMS of places, m", places["rms"], 0.17),
        goal("lidar: RMS with velocities, m", moving["rms"], 0.11),
        goal("lidar: identity switches", places["switches"] + moving["switches"], 0.0),
        goal("lidar: NEES, least", places["nees"], 0.9, at_most=False),
        goal("lidar: NEES, largest", places["nees"], 1.2),
    ]


def tables(figures: Figures) -> list[Table]:
    """Return the scores of each tracker, filtered / smoothed."""

    def both(tracker: str, name: str, form: str) -> str:
        each = (cell(figures, [tracker, source, name], form) for source in ("filtered", "smoothed"))
        return " / ".join(each)

    rows = [(name, *(both(name, *shown) for shown in FIGURES.items())) for name in TRACKERS]
    return [table("Places of a lidar, filtered / smoothed", ("tracker", *FIGURES), rows)]


STUDY = Study(
    name="positions",
    purpose=__doc__.split("\n", 1)[0],
    measure=measure,
    tables=tables,
    goals=goals,
    seed=84000,
    runs=12,
)
