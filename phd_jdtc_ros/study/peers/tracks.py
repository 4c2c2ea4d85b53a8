"""Runs the track-based peers, and extracts their estimates at a lag."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.evaluation.comparison import PointSet

from .conversion import VELOCITY, point_set
from .management import LooksMissed, NoInitiator, initiator
from .problem import Problem
from .settings import TrackSettings
from .soup import Part, Soup


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
    """Run one of Stone Soup's trackers.

    Parameters
    ----------
    tracker_type : Part
        `MultiTargetTracker` or `MultiTargetMixtureTracker`.
    associator : callable
        The data associator for a radar.
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
