"""The turns that are found in plots."""

import numpy as np
import pytest
from plot_recordings import recorded

from phd_jdtc_ros.calibration.tuning.findings import TuningError, findings
from phd_jdtc_ros.calibration.tuning.rotation import PlotTurns, timing_of

NS = 10**9
BEGIN_S = 20_779 * 86_400.0


def swept(rotation_s, seconds, per_s, wobble=0.0, seed=1, begin_s=0.0):
    """Return times, s, and azimuths of plots, ascending, of an antenna whose speed swings."""
    rng = np.random.default_rng(seed)
    time_s = np.sort(rng.uniform(begin_s, begin_s + seconds, round(seconds * per_s)))
    swing = wobble * 300.0 / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * time_s / 300.0))
    turned = (time_s + swing) / rotation_s
    azimuth = 2.0 * np.pi * (turned % 1.0)
    # Nothing is seen in the west.
    seen = (azimuth < 3.5) | (azimuth > 5.2)
    return time_s[seen], azimuth[seen]


def found(*plots):
    turns = PlotTurns()
    for time_s, azimuth in plots:
        for each_s, own in zip(time_s, azimuth, strict=True):
            turns.add(own, round((BEGIN_S + each_s) * NS))
    turns.find()
    return turns.turn_s


@pytest.mark.parametrize(
    ("rotation_s", "per_s"), [(1.008, 5.0), (4.0016, 12.0), (7.63, 10.0), (12.03, 8.0)]
)
def test_turn_of_an_even_antenna_is_exact(rotation_s, per_s):
    assert found(swept(rotation_s, 1200.0, per_s)) == pytest.approx(rotation_s, abs=1e-4)


@pytest.mark.parametrize(("rotation_s", "wobble"), [(1.008, 0.01), (4.0016, 0.005), (12.03, 0.005)])
def test_mean_turn_of_an_antenna_that_wanders_is_found(rotation_s, wobble):
    # Whole periods, so that the mean of the turns is that of an even antenna.
    turn_s = found(swept(rotation_s, 1800.0, 8.0, wobble))
    assert turn_s == pytest.approx(rotation_s, rel=2e-4)


def test_turn_is_followed_over_gaps_and_switches():
    plots = [swept(4.0016, 300.0, 12.0, seed=k, begin_s=1000.0 * k) for k in range(4)]
    assert found(*plots) == pytest.approx(4.0016, abs=1e-4)
    slow = swept(4.0016, 300.0, 12.0)
    fast = swept(2.5, 600.0, 12.0, begin_s=300.0)
    assert found(slow, fast) == pytest.approx(2.5, abs=1e-3)
    time_s, azimuth = swept(4.0016, 120.0, 12.0)
    time_s[5] += 3600.0
    assert found((time_s, azimuth)) == pytest.approx(4.0016, abs=1e-3)


def test_turns_are_known_after_a_minute_where_there_are_any():
    turns = PlotTurns()
    time_s, azimuth = swept(4.0016, 61.0, 12.0)
    for each_s, own in zip(time_s, azimuth, strict=True):
        turns.add(own, round(each_s * NS))
    assert turns.turn_s == pytest.approx(4.0016, abs=0.01)
    assert found(swept(4.0, 30.0, 12.0)) == pytest.approx(4.0, abs=0.01)
    rng = np.random.default_rng(3)
    time_s = np.sort(rng.uniform(0.0, 600.0, 3000))
    assert found((time_s, rng.uniform(0.0, 2.0 * np.pi, 3000))) == 0.0
    time_s = np.arange(0.0, 300.0, 0.1)
    assert found((time_s, np.full(len(time_s), 1.0))) == 0.0


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("clockwise", [True, False])
def test_sectors_and_direction_are_those_of_the_antenna(timed, clockwise):
    rng, way = np.random.default_rng(1), -1.0 if clockwise else 1.0
    clouds, times_s = [], []
    for cloud in range(200):
        times_s.append(np.sort(rng.uniform(0.0, 0.25, 3)))
        azimuth = way * 2.0 * np.pi * (0.25 * cloud + times_s[-1]) / 3.0
        clouds.append(np.stack([rng.uniform(1e3, 9e3, 3), azimuth], axis=1))
    turn = timing_of(recorded(clouds, 0.25, times_s if timed else None))
    assert turn.rotation_s == pytest.approx(3.0, rel=3e-3)
    assert (turn.sectors, turn.clockwise) == (12, clockwise)


def test_no_more_sectors_are_proposed_than_are_allowed():
    # An antenna that turns in 3 s: each of the 300 plots of a turn is a cloud.
    distance = np.random.default_rng(1).uniform(1e3, 9e3, (2000, 1))
    azimuth = -2.0 * np.pi * 0.01 * np.arange(2000).reshape(-1, 1) / 3.0
    clouds = np.stack([distance, azimuth], axis=2)
    plots = recorded(clouds, 0.01, [np.zeros(1)] * 2000)
    assert plots.timed
    assert timing_of(plots).rotation_s == pytest.approx(3.0, rel=3e-3)
    assert timing_of(plots).sectors == 0
    with pytest.raises(TuningError, match=r"about 300 clouds in a turn of 3 s, must be"):
        findings(recorded(clouds, 0.01))


@pytest.mark.parametrize("interval_s", [0.1, 1.0, 6.0])
def test_targets_in_one_direction_are_no_turning_antenna(interval_s):
    rng = np.random.default_rng(1)
    clouds = np.stack([rng.uniform(1e3, 9e3, (150, 3)), rng.normal(1.0, 0.3, (150, 3))], axis=2)
    assert timing_of(recorded(clouds, interval_s)).rotation_s == 0.0
