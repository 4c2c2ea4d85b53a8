"""Ships in sight of one radar, some of which report themselves: plots, reports and truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Detections, SelfReports
from phd_jdtc_ros.core.types.reports import MMSI

START_NS = 1_700_000_000_000_000_000
TURN_S = 2.5
THRESHOLD = 3.7
PARAMETERS = {
    "sensors": ["radar", "ais"],
    "classes": ["ship"],
    "motions": ["cv"],
    "cv.noise_density": 0.02,
    "interval_s": TURN_S,
    "max_gap_scans": 30.0,
    "ship.snr_band_db": [18.0, 22.0],
    "ship.motions": ["cv"],
    "ship.mode_transition": [1.0],
    "ship.survival_probability": 0.9999,
    "detection_births.rates": [0.2],
    "detection_births.std": [5.0],
    "radar.position": [0.0, 0.0],
    "radar.range_std": 12.0,
    "radar.azimuth_std_deg": 0.3,
    "radar.max_range": 12000.0,
    "radar.detection_probability": 0.9,
    "radar.clutter_rate": 5.0,
    "radar.clutter_max_range": 12000.0,
    "radar.learn": [],
    "radar.false_alarm_probability": float(np.exp(-0.5 * THRESHOLD**2)),
    "ais.kind": "reports",
    "ais.obliged": ["ship"],
}
# Kinds of ships: equipped, with an antenna 50 m ahead; silent; lying from `LIES_S` on, by 5 m/s;
# and two that share one address.
OK, DARK, LIAR, CLONE = "ok", "dark", "liar", "clone"
KINDS = (OK, OK, DARK, LIAR, CLONE, CLONE)
LIES_S, OFFSET = 150.0, 50.0


class Turn(NamedTuple):
    """What came within a turn of the radar, and where the ships were at its end."""

    stamp_ns: int
    plots: Detections
    reports: SelfReports
    truth: FloatArray  # Positions, (N, 2)


def configured(more=None):
    """Return the configuration of the scene, with further parameters."""
    return resolve(PARAMETERS | (more or {}))


def turns(seed, seconds=300.0, kinds=KINDS):
    """Return the turns of the radar; the address of ship i is 1001 + i, of clones the first's."""
    rng, count = np.random.default_rng(seed), len(kinds)
    place = np.stack([np.linspace(-4000.0, 4000.0, count), rng.uniform(2000, 5000, count)], 1)
    course, speed = rng.uniform(-np.pi, np.pi, count), rng.uniform(3.0, 5.5, count)
    velocity = speed[:, None] * np.stack([np.cos(course), np.sin(course)], 1)
    due, address = rng.uniform(0.0, 10.0, count), 1001 + np.arange(count)
    clones = np.flatnonzero([kind == CLONE for kind in kinds])
    address[clones] = address[clones[0]] if len(clones) else 0
    found = []
    for turn in range(int(seconds / TURN_S)):
        end_s, rows = (turn + 1) * TURN_S, []
        for i in np.flatnonzero(due <= end_s):
            time_s, due[i] = due[i], due[i] + 10.0
            if kinds[i] == DARK or rng.random() > 0.85:
                continue
            ahead = velocity[i] / speed[i]
            lie = 5.0 * max(time_s - LIES_S, 0.0) * (kinds[i] == LIAR)
            at = place[i] + velocity[i] * time_s + OFFSET * ahead + lie * np.array([-1.0, 0.0])
            noise = rng.normal(0.0, [8.0, 8.0, 0.2, 0.2])
            rows.append((np.floor(time_s), address[i], *at + noise[:2], *velocity[i] + noise[2:]))
        table = np.array(rows).reshape(-1, 6)
        stamp_ns = START_NS + round(end_s * 1e9)
        reports = SelfReports.of(
            START_NS + (table[:, 0] * 1e9).astype(np.int64),
            table[:, 2:4],
            covariance=np.tile(64.0 * np.eye(2), (len(table), 1, 1)),
            velocity=table[:, 4:6],
            address=table[:, 1].astype(np.int64),
            space=np.full(len(table), MMSI),
        )
        truth = place + velocity * end_s
        found.append(Turn(stamp_ns, _plots(rng, truth), reports, truth))
    return found


def _plots(rng, truth):
    seen, false = rng.random(len(truth)) < 0.9, rng.poisson(5.0)
    polar = np.stack([np.hypot(*truth.T), np.arctan2(truth[:, 1], truth[:, 0])], 1)
    polar += rng.normal(0.0, [12.0, np.radians(0.3)], polar.shape)
    clutter = np.stack([rng.uniform(100, 12000, false), rng.uniform(-np.pi, np.pi, false)], 1)
    of_ships = np.sqrt(THRESHOLD**2 - 2.0 * 101.0 * np.log(rng.random(seen.sum())))
    of_clutter = np.sqrt(THRESHOLD**2 - 2.0 * np.log(rng.random(false)))
    return Detections(
        np.concatenate([polar[seen], clutter]), np.concatenate([of_ships, of_clutter])
    )
