"""Scores of this package's tracker and of its peers on the Autoferry dataset.

All trackers get the radar's detections with the ferry's pose; in one variant this package's tracker
also gets the lidar's. At every scan of the radar the estimates are compared with the two vessels
whose positions are known. Tracks of other boats and of quays, which are detected too, count as
false estimates.

Notes
-----
The tracker's profile and the peers' settings were chosen by the mean GOSPA of scenarios 3 and 5.
The other scenarios were not used for the choice. Tried for the peers: gates of 2.5 to 3.5 standard
deviations, 4 to 12 detections to confirm a track, deletion of confirmed tracks after 2 to 5 missed
looks and of tentative ones after 1 or 2, noise densities of 0.03 to 0.3 m^2/s^3, and measurement
standard deviations of 5 m and 1, 1.5 and 2.5 degrees or 9 m and 2.5 degrees. Narrow gates are best:
they lose most tracks of other objects before these are confirmed. Neither this package's tracker
nor the peers report what rests: the tracker has a class for it, and the peers leave out tracks that
are slower than 0.7 m/s, with which their mean over all scenarios is better than without.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.engine import Engine
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, Estimates, Scan, Truth
from phd_jdtc_ros.evaluation.comparison import LabelledPoints, PointSet
from phd_jdtc_ros.evaluation.metrics import gospa
from phd_jdtc_ros.evaluation.tracks import IdentitySwitches
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.study.tracker import SimulatedRun

from ..peers import gnn, jpda
from ..peers.settings import TrackSettings
from ..runner import Goal, goal
from .recording import Recording

CUTOFF, ORDER = 50.0, 2.0
# Goals: ratio of the mean GOSPA over all scenarios to the better peer's.
GOALS = {FILTERED: 0.85, SMOOTHED: 0.8}
PEERS = ("GNN", "JPDA")
GAUSSIAN, WITH_LIDAR = "gaussian", "with lidar"
PEER_SETTINGS = TrackSettings(
    gate=2.5, points=8, tentative_looks=1, looks=3, birth_gate=None, min_speed=0.7
)
# Model of the peers: spectral density of the acceleration, m^2/s^3, and the radar's noise.
PEER_NOISE_DENSITY = 0.1
PEER_RADAR = {
    "radar.range_std": 5.0,
    "radar.azimuth_std_deg": 1.0,
    "radar.detection_probability": 0.9,
    "radar.clutter_rate": 3.0,
    "detection_births.std": [5.0, 0.02],
}


@dataclass(frozen=True)
class Score:
    """The scores of a tracker on a scenario, means over all scans of the radar."""

    scenario: int
    tracker: str
    source: str  # ``filtered`` or ``smoothed``
    gospa: float  # GOSPA, metres
    # `missed`, `false`: targets without an estimate and estimates without a target, per scan.
    missed: float
    false: float
    # Root mean square error of the pairs closer than the cutoff, metres; None without any.
    position_rms: float | None
    identity_switches: int | None = None  # None if estimates have no labels


def scans_of(recording: Recording, sensors: Sequence[str] = ("radar",)) -> list[Scan]:
    """Return the scans of some sensors, each with the sensor's pose."""
    scans = []
    looks = (look for look in recording.looks if look.sensor in sensors)
    for stamp_ns, of_stamp in itertools.groupby(looks, lambda look: look.stamp_ns):
        seen = {look.sensor: replace(look.detections, pose=look.own) for look in of_stamp}
        scans.append(Scan(stamp_ns, tuple(map(seen.get, sensors))))
    return scans


def scores_of(
    recording: Recording,
    parameters: Mapping[str, Any],
    with_lidar: Mapping[str, Any] | None = None,
    changes: Mapping[str, Any] | None = None,
) -> list[Score]:
    """Return the scores of the tracker and both peers, filtered and smoothed.

    The parameters are those of a tracker with the radar alone, and `with_lidar` of one with both
    sensors, which None leaves out. `changes` replace parameters of our trackers; the lidar's
    concern the second one only. Raise `ImportError` without Stone Soup.
    """
    scans = scans_of(recording)
    truth = [recording.truth(scan.stamp_ns) for scan in scans]
    found: dict[tuple[str, str], Sequence[PointSet]] = {}
    changes = changes or {}
    of_radar = {name: own for name, own in changes.items() if not name.startswith("lidar.")}
    engine = new_engine(resolve({**parameters, **of_radar}))
    found |= _of_sources(GAUSSIAN, tracked(engine, scans), truth)
    if with_lidar is not None:
        config = resolve({**with_lidar, **changes})
        both = scans_of(recording, config.values["sensors"])
        found |= _of_sources(WITH_LIDAR, tracked(new_engine(config), both), truth)
    lag, model, interval_s = peer_problem(parameters)
    scenario = Scenario(scans[0].stamp_ns, interval_s, len(scans), (), polar_radars(model.radars))
    run = SimulatedRun(scenario, 0, tuple(truth), tuple(scans), ())
    tracks = {
        "GNN": gnn(run, model, PEER_SETTINGS, (0, lag)),
        "JPDA": jpda(run, model, PEER_SETTINGS, (0, lag)),
    }
    for name, by_lag in tracks.items():
        found[name, FILTERED], found[name, SMOOTHED] = by_lag[0], by_lag[lag]
    return [_score(recording.scenario, *key, truth, points) for key, points in found.items()]


def peer_problem(parameters: Mapping[str, Any]) -> tuple[int, TrackerModel, float]:
    """Return the lag in scans, the model of the peers, and the interval in seconds.

    The peers have one motion model, and noise, clutter rate and detection probability of their own.
    """
    config = resolve(parameters)
    of_motions = tuple(f"{name}." for name in config.values["motions"])
    given = {name: value for name, value in parameters.items() if not name.startswith(of_motions)}
    classes: dict[str, Any] = {}
    for name in config.values["classes"]:
        classes |= {f"{name}.motions": ["straight"], f"{name}.mode_transition": [1.0]}
    one = {"motions": ["straight"], "straight.noise_density": PEER_NOISE_DENSITY}
    model = resolve({**given, **classes, **one, **PEER_RADAR}).model
    return config.lag.scans, model, model.modes.interval_s


def tracked(engine: Engine, scans: Sequence[Scan]) -> dict[str, list[Estimates]]:
    """Return the estimates of scans by source."""
    filtered: list[Estimates] = []
    smoothed: list[Estimates] = []
    for scan in scans:
        step = engine.step(scan)
        filtered += step.filtered
        smoothed += step.smoothed
    smoothed += engine.flush()
    return {FILTERED: filtered, SMOOTHED: smoothed}


def _of_sources(
    tracker: str, found: Mapping[str, Sequence[Estimates]], truth: Sequence[Truth]
) -> dict[tuple[str, str], Sequence[PointSet]]:
    """Return a tracker's estimates at the stamps of the truth, by tracker and source."""
    return {
        (tracker, source): [PointSet.of(by_stamp[targets.stamp_ns]) for targets in truth]
        for source, estimates in found.items()
        for by_stamp in [{each.stamp_ns: each for each in estimates}]
    }


def _score(
    scenario: int, tracker: str, source: str, truth: Sequence[Truth], found: Sequence[PointSet]
) -> Score:
    scans = [
        gospa(targets.position, points.position, CUTOFF, ORDER)
        for targets, points in zip(truth, found, strict=True)
    ]
    pairs = sum(
        len(targets.track_id) - scan.missed for targets, scan in zip(truth, scans, strict=True)
    )
    square = sum(scan.localization**ORDER for scan in scans)
    return Score(
        scenario,
        tracker,
        source,
        float(np.mean([scan.distance for scan in scans])),
        float(np.mean([scan.missed for scan in scans])),
        float(np.mean([scan.false for scan in scans])),
        math.sqrt(square / pairs) if pairs else None,
        _switches(truth, found),
    )


def _switches(truth: Sequence[Truth], found: Sequence[PointSet]) -> int | None:
    if any(points.track_id is None for points in found):
        return None
    counter = IdentitySwitches(CUTOFF)
    return sum(
        counter.add(
            LabelledPoints(targets.track_id, targets.position),
            LabelledPoints(points.track_id, points.position),
        )
        for targets, points in zip(truth, found, strict=True)
        if points.track_id is not None
    )


def means(scores: Sequence[Score]) -> dict[tuple[str, str], dict[str, float]]:
    """Return the means over scenarios by tracker and source."""
    found = {}
    for key in dict.fromkeys((score.tracker, score.source) for score in scores):
        rows = [score for score in scores if (score.tracker, score.source) == key]
        found[key] = {
            name: float(np.nanmean(np.array([getattr(row, name) for row in rows], dtype=float)))
            for name in ("gospa", "missed", "false", "position_rms")
        }
    return found


def goals_of(scores: Sequence[Score]) -> list[Goal]:
    """Return the goals: ratio of the tracker's GOSPA to the better peer's, by source."""
    of_tracker, goals = means(scores), []
    for source, bound in GOALS.items():
        better = min(of_tracker[peer, source]["gospa"] for peer in PEERS)
        ratio = of_tracker[GAUSSIAN, source]["gospa"] / better
        goals.append(goal(f"GOSPA {source}, {GAUSSIAN}, to the better peer's", ratio, bound))
    return goals
