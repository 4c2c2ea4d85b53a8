"""Joint probabilistic data association."""

from __future__ import annotations

import math
from collections.abc import Iterable

from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel

from ..runs import SimulatedRun, Tracks
from .conversion import clutter_density
from .problem import Problem
from .settings import AT_BIRTH_PLACES, LOUD, LOUD_THRESHOLD, TrackSettings
from .soup import Part
from .threshold import raised_threshold
from .tracks import at_lag, follow


def jpda(
    run: SimulatedRun,
    settings: TrackSettings = AT_BIRTH_PLACES,
    lags: Iterable[int] = (0,),
    model: TrackerModel | None = None,
) -> Tracks:
    """Return the estimates of joint probabilistic data association, by lag.

    Parameters
    ----------
    lags : iterable of int
        See `gnn`, which has the same smoother.
    model : TrackerModel or None
        See `Problem.of`.

    Returns
    -------
    Tracks
        The tracks reported by `at_lag`; all of class 0.

    Notes
    -----
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


def jpda_loud(run: SimulatedRun, model: TrackerModel | None = None) -> Tracks:
    """Return the estimates of `jpda` from detections of high amplitude only, at lag 0.

    Settings and errors are the same as of `gnn_loud`.
    """
    return jpda(raised_threshold(run, LOUD_THRESHOLD), settings=LOUD, model=model)
