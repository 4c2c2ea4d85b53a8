"""Aircraft that are hard to follow: turns of 3 g, and a radar of coarse azimuths.

Both scenes have one radar with a revolution of 4 s and the motion of the profile for aircraft. In
the first, aircraft fly straight and turn with 3 g, by which they leave the predicted position by
more than the noise. In the second, the azimuth noise is 3 degrees, so that many aircraft are within
the noise of others.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.arrays import BoolArray
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.evaluation.comparison import LabelledPoints, PointSet
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.evaluation.tracks import IdentitySwitches
from phd_jdtc_ros.parameter_files import sections
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.targets import STANDARD_GRAVITY, Flight, Leg
from phd_jdtc_ros.study.tracker import SimulatedRun, track_turning, turning_run

from .peers.plot_kalman import plot_kalman
from .runner import Figures, Study, figures_table

PROFILE = Path("config/air_traffic.yaml")
# Expected false detections in a revolution; the profile's radar learns them, but a scene needs a
# number.
CLUTTER = {"approach.clutter_rate": 10.0}
START_NS, DURATION_S, INTERVAL_S = 1000 * 10**9, 300.0, 4.0
# Acceleration of a turn, its angle in degrees, and straight flight between turns in seconds.
ACCELERATION, ANGLE_DEG, STRAIGHT_S = 3.0 * STANDARD_GRAVITY, (60.0, 180.0), (40.0, 90.0)
SPEED = (150.0, 250.0)
LAGS = {"filtered": 0, "smoothed": 5}
# Targets are scored after this number of revolutions, when tracks are established.
SETTLING = 8


class Scene(NamedTuple):
    """Traffic, and what its radar and its scores depend on."""

    aircraft: int
    radius: float  # Aircraft begin within this distance of the radar, metres
    turns: bool  # True if aircraft turn
    near: float  # Distance within which an estimate is of a target, metres
    parameters: Mapping[str, Any]


SCENES = {
    "turns of 3 g": Scene(18, 60e3, True, 500.0, {}),
    "azimuths of 3 degrees": Scene(
        40, 40e3, False, 4000.0, {"approach.azimuth_std_deg": 3.0, "approach.range_std": 100.0}
    ),
}


def scenario(scene: Scene, parameters: Mapping[str, Any], rng: np.random.Generator) -> Scenario:
    """Return random traffic of a scene with the radar of some parameters."""
    return Scenario(
        start_ns=START_NS,
        interval_s=INTERVAL_S,
        scans=int(DURATION_S / INTERVAL_S) + 1,
        targets=tuple(_flight(scene, rng) for _ in range(scene.aircraft)),
        radars=polar_radars(resolve(parameters).model.radars),
    )


def _flight(scene: Scene, rng: np.random.Generator) -> Flight:
    speed, course = rng.uniform(*SPEED), rng.uniform(-math.pi, math.pi)
    place, bearing = scene.radius * math.sqrt(rng.random()), rng.uniform(-math.pi, math.pi)
    legs, left_s = [], DURATION_S
    while scene.turns and left_s > 0.0:
        rate = rng.choice([-1.0, 1.0]) * ACCELERATION / speed
        turn_s = math.radians(rng.uniform(*ANGLE_DEG)) / abs(rate)
        legs += [Leg(rng.uniform(*STRAIGHT_S)), Leg(turn_s, rate)]
        left_s -= legs[-1].duration_s + legs[-2].duration_s
    return Flight(
        0,
        snr_from_db(30.0),
        0.0,
        (place * math.cos(bearing), place * math.sin(bearing)),
        (speed * math.cos(course), speed * math.sin(course)),
        tuple(legs) or (Leg(DURATION_S),),
    )


def measure(arguments: argparse.Namespace, seed: int) -> Figures:
    """Return the scores of a seed, by scene and source."""
    profile = {**sections.read(resources.find(PROFILE)).values("/tracker"), **CLUTTER}
    found: Figures = {}
    for name, scene in SCENES.items():
        given = {**profile, **scene.parameters}
        rng = np.random.default_rng([seed, len(name)])
        run = turning_run(scenario(scene, given, rng), seed)
        own = track_turning(run, given, tuple(LAGS.values())).tracks
        peer = plot_kalman(run, given, [0]).tracks[0]
        sources = {**{source: own[lag] for source, lag in LAGS.items()}, "plot Kalman": peer}
        found[name] = {
            source: scores(run, points, scene.near) for source, points in sources.items()
        }
    return {"scenes": found}


def scores(run: SimulatedRun, found: Sequence[PointSet], near: float) -> Figures:
    """Return the scores of a tracker's estimates at each revolution.

    ``found`` is the share of targets with an estimate within `near`; ``lost`` the number of times
    that a target has none in three revolutions or more; ``rms`` is in metres; ``false_tracks`` the
    number of track numbers that are farther than `near` from all targets in most of their
    revolutions.
    """
    switches, identity = 0, IdentitySwitches(near)
    there, right, away = [], Counter[int](), Counter[int]()
    squares: list[float] = []
    for index, (truth, points) in enumerate(zip(run.truth, found, strict=True)):
        labels = points.track_id
        labels = np.zeros(0, dtype=np.int64) if labels is None else labels
        target, estimate = assign(truth.position, points.position, near)
        paired = set(labels[estimate].tolist())
        right.update(paired)
        away.update(set(labels.tolist()) - paired)
        known = LabelledPoints(truth.track_id, truth.position)
        switches += identity.add(known, LabelledPoints(labels, points.position), points.coasting)
        if index >= SETTLING:
            error = truth.position[target] - points.position[estimate]
            squares += (error**2).sum(axis=1).tolist()
            there.append(np.isin(truth.track_id, truth.track_id[target]))
    return {
        "found": float(np.mean(there)),
        "lost": _losses(np.array(there)),
        "rms": float(np.sqrt(np.mean(squares))),
        "switches": switches,
        "false_tracks": sum(away[number] > right[number] for number in away),
    }


def _losses(there: BoolArray) -> int:
    """Return how often a column of (revolutions, targets) is false for three or more."""
    three = ~(there[:-2] | there[1:-1] | there[2:])
    begins = three & ~np.concatenate([np.zeros((1, three.shape[1]), dtype=bool), three[:-1]])
    return int(begins.sum())


def tables(figures: Figures) -> list[Table]:
    """Return a table of each scene."""
    columns = {
        "found": ("found", ".2%"),
        "lost": ("lost for 3 revolutions", ".2f"),
        "rms": ("RMS, m", ".1f"),
        "switches": ("switches", ".1f"),
        "false_tracks": ("false tracks", ".1f"),
    }
    return [
        figures_table(
            name, "tracks", figures, columns, {source: ("scenes", name, source) for source in scene}
        )
        for name, scene in figures["scenes"].items()
    ]


STUDY = Study(
    name="hard_traffic",
    purpose=__doc__.split("\n", 1)[0],
    measure=measure,
    tables=tables,
    seed=63000,
    runs=12,
)
