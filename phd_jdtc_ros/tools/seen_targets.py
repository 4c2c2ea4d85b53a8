"""How often a recording's true targets were detected: the truth of a detection probability."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phd_jdtc_ros.calibration.tuning.plots import Plots
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel, wrap_angle
from phd_jdtc_ros.core.types import Truth

# A plot within so many deviations of a target is its.
GATE = 4.0
# A turning radar passes a target once a turn: no second plot within this part of it counts.
AGAIN = 0.5
# Stamps of the truth and of clouds that are the same, seconds.
SAME_STAMP_S = 1e-3


def share_detected(truth: Sequence[Truth], plots: Plots, radar: RadarModel) -> float:
    """Return the share of looks in which targets in the radar's field were detected.

    Parameters
    ----------
    truth : sequence of Truth
        In the order of time.
    plots : Plots
        Of a radar that stands.
    radar : RadarModel
        Where it is and its noise, as they were simulated.

    Returns
    -------
    float
        NaN without targets.
    """
    hits, chances = 0, 0.0
    for number in np.unique(np.concatenate([targets.track_id for targets in truth])):
        found = [(each, np.flatnonzero(each.track_id == number)) for each in truth]
        there = [(each, rows[0]) for each, rows in found if len(rows)]
        if len(there) < 2:
            continue
        stamp_s = np.array([(each.stamp_ns - plots.zero_ns) * 1e-9 for each, _ in there])
        state = np.array([each.state[row] for each, row in there])
        inside = radar.visibility.sees(radar.measure(state)) > 0.0
        time_s = _detected(stamp_s, state, plots, radar)
        if radar.rotation_s:
            again = np.diff(time_s) < AGAIN * radar.rotation_s
            hits += len(time_s) - int(np.count_nonzero(again))
            turns = np.diff(stamp_s) * inside[1:] / radar.rotation_s
            chances += float(turns.sum())
        else:
            hits += len(np.unique(time_s))
            near = np.abs(plots.cloud_s[:, None] - stamp_s[inside]) < SAME_STAMP_S
            chances += np.count_nonzero(near.any(axis=1))
    return hits / chances if chances else float("nan")


def _detected(
    stamp_s: FloatArray, state: FloatArray, plots: Plots, radar: RadarModel
) -> FloatArray:
    """Return the times of the plots near a target, ascending, seconds.

    Parameters
    ----------
    stamp_s : array of shape (K,)
    state : array of shape (K, D)
        Of the target at these times.
    plots : Plots
    radar : RadarModel
    """
    during = (plots.time_s >= stamp_s[0]) & (plots.time_s <= stamp_s[-1])
    time_s = plots.time_s[during]
    then = np.stack([np.interp(time_s, stamp_s, column) for column in state.T], axis=1)
    expected = radar.measure(then)
    error = plots.measurement[during] - expected
    error[:, 1] = wrap_angle(error[:, 1])
    near = ((error / radar.noise_std) ** 2).sum(axis=1) < GATE**2
    near &= radar.visibility.sees(expected) > 0.0
    return time_s[near]
