"""The peers with tracks: global nearest neighbour (GNN) and JPDA, with a smoother.

Lag 0 is the extended Kalman filter. A larger lag L is Stone Soup's `ExtendedKalmanSmoother`
(Rauch-Tung-Striebel) over the following L scans, fewer at the end of the run. All estimates have
class 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.study.tracker import SimulatedRun, Tracks

from .conversion import VELOCITY, clutter_density, point_set
from .management import LooksMissed, NoInitiator, initiator
from .problem import Problem
from .settings import AT_BIRTH_PLACES, TrackSettings
from .soup import Part, Soup


def gnn(
    run: SimulatedRun,
    model: TrackerModel,
    settings: TrackSettings = AT_BIRTH_PLACES,
    lags: Iterable[int] = (0,),
) -> Tracks:
    """Return the estimates of global nearest neighbour tracking, by lag; see `Problem.of`."""
    problem = Problem.of(run, model)
    soup = problem.soup
    associator = soup.GNNWith2DAssignment(problem.hypothesiser(settings.gate))
    history = follow(problem, soup.MultiTargetTracker, lambda _: associator, settings)
    return {lag: at_lag(problem, history, lag, settings) for lag in lags}


def jpda(
    run: SimulatedRun,
    model: TrackerModel,
    settings: TrackSettings = AT_BIRTH_PLACES,
    lags: Iterable[int] = (0,),
) -> Tracks:
    """Return the estimates of joint probabilistic data association, by lag; as `gnn`.

    The association probabilities are exact (`JPDAwithEHM`). Tentative tracks are associated by
    nearest neighbour, as in Stone Soup's examples.
    """
    problem = Problem.of(run, model)
    soup = problem.soup

    def associator(radar: RadarModel) -> Part:
        return soup.JPDAwithEHM(
            soup.PDAHypothesiser(
                predictor=problem.predictor,
                updater=problem.updater,
                clutter_spatial_density=clutter_density(radar),
                prob_detect=problem.detection_probability(radar),
                prob_gate=1.0 - math.exp(-0.5 * settings.gate**2),
            )
        )

    history = follow(problem, soup.MultiTargetMixtureTracker, associator, settings)
    return {lag: at_lag(problem, history, lag, settings) for lag in lags}


@dataclass(frozen=True)
class History:
    """The confirmed tracks of a run."""

    stamps: list[datetime]
    confirmed: dict[Part, int]  # The scan that confirmed each track


def follow(
    problem: Problem,
    tracker_type: Part,
    associator: Callable[[RadarModel], Part],
    settings: TrackSettings,
) -> History:
    """Run one of Stone Soup's trackers, with the data associator of each radar.

    Its type is `MultiTargetTracker` or `MultiTargetMixtureTracker`.
    """
    tracker = tracker_type(
        initiator=NoInitiator(),
        deleter=LooksMissed(problem.soup, settings.looks),
        detector=None,
        data_associator=None,
        updater=problem.updater,
    )
    start = initiator(problem, settings)
    history = History([], {})
    for scan, (stamp, looks) in enumerate(problem.scans()):
        for radar, detections in looks:
            tracker.data_associator = associator(radar)
            tracker.update_tracker(stamp, detections)
            claimed = {claim(problem.soup, track) for track in tracker.tracks}
            tracker.tracks.update(start.initiate(detections - claimed, stamp))
        history.stamps.append(stamp)
        for track in tracker.tracks:
            history.confirmed.setdefault(track, scan)
    return history


def claim(soup: Soup, track: Part) -> Part | None:
    """Return the most probable detection of a track, or None after a miss."""
    if not isinstance(track.state, soup.Update):
        return None
    hypothesis = track.state.hypothesis
    if hasattr(hypothesis, "measurement"):
        return hypothesis.measurement
    return max(hypothesis, key=lambda single: single.probability).measurement


def at_lag(problem: Problem, history: History, lag: int, settings: TrackSettings) -> list[PointSet]:
    """Return every scan's tracks given the data up to `lag` scans later.

    A confirmed track is reported from its first to its last detection: in a gap closed by a later
    detection, but not while it coasts towards deletion. Confirmations and closed gaps within the
    lag are taken into account.
    """
    soup, stamps = problem.soup, history.stamps
    smoother = soup.ExtendedKalmanSmoother(problem.predictor.transition_model)
    reports = []
    for scan, stamp in enumerate(stamps):
        until = min(scan + lag, len(stamps) - 1)
        known = [track for track, since in history.confirmed.items() if since <= until]
        found = []
        for track in known:
            states = [s for s in track.states if s.timestamp <= stamps[until]]
            seen = [s.timestamp for s in states if isinstance(s, soup.Update)]
            if seen[0] <= stamp <= seen[-1]:
                before = sum(s.timestamp <= stamp for s in states) - 1
                state = smoother.smooth(soup.Track(states[before:])).states[0]
                velocity = np.asarray(state.state_vector, dtype=float)[VELOCITY, 0]
                if np.hypot(*velocity) >= settings.min_speed:
                    found.append(state)
        reports.append(point_set(found))
    return reports
