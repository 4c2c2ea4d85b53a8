"""Global nearest neighbour tracking with a Rauch-Tung-Striebel smoother, in three variants."""

from __future__ import annotations

from collections.abc import Iterable

from phd_jdtc_ros.core.models.tracker_model import TrackerModel

from ..runs import SimulatedRun, Tracks
from .problem import Problem
from .settings import ANYWHERE, AT_BIRTH_PLACES, LOUD, LOUD_THRESHOLD, TrackSettings
from .threshold import raised_threshold
from .tracks import at_lag, follow


def gnn(
    run: SimulatedRun,
    lags: Iterable[int] = (0,),
    settings: TrackSettings = AT_BIRTH_PLACES,
    model: TrackerModel | None = None,
) -> Tracks:
    """Return the estimates of global nearest neighbour tracking, by lag.

    Parameters
    ----------
    lags : iterable of int
        Lag 0 is the extended Kalman filter. A larger lag L is Stone Soup's
        `ExtendedKalmanSmoother` (Rauch-Tung-Striebel) over the following L scans, fewer at the end
        of the run.
    model : TrackerModel or None
        See `Problem.of`.

    Returns
    -------
    Tracks
        The tracks reported by `at_lag`; all of class 0.
    """
    problem = Problem.of(run, model)
    soup = problem.soup
    associator = soup.GNNWith2DAssignment(problem.hypothesiser(settings.gate))
    history = follow(problem, soup.MultiTargetTracker, lambda _: associator, settings)
    return {lag: at_lag(problem, history, lag, settings) for lag in lags}


def gnn_loud(
    run: SimulatedRun, lags: Iterable[int] = (0,), model: TrackerModel | None = None
) -> Tracks:
    """Return the estimates of `gnn` from detections of high amplitude only.

    The threshold leaves so little clutter that two detections suffice to confirm a track. See `gnn`
    for parameters and result.

    Raises
    ------
    ValueError
        If a radar's own threshold is above `LOUD_THRESHOLD`.
    """
    return gnn(raised_threshold(run, LOUD_THRESHOLD), lags, LOUD, model)


def gnn_anywhere(
    run: SimulatedRun, lags: Iterable[int] = (0,), model: TrackerModel | None = None
) -> Tracks:
    """Return the estimates of `gnn` with tracks started anywhere, not only at birth places.

    See `gnn` for parameters and result.
    """
    return gnn(run, lags, ANYWHERE, model)
