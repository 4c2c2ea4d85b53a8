import numpy as np
from estimate_sets import of_tracks

from phd_jdtc_ros.handover.restarts import KEPT_S, SERIES, TrackSeries

NS = 10**9


def estimates(stamp, tracks, speed=200.0):
    """Return estimates of tracks by number, each its x."""
    return of_tracks(
        {n: (x, 0.0) for n, x in tracks.items()}, (speed, 0.0), np.ones(5), stamp_ns=stamp * NS
    )


def followed(*said):
    """Return the unique numbers of all estimates, stamp by stamp, and the series."""
    series, found = TrackSeries(), []
    for stamp, tracks in said:
        own = None if tracks is None else estimates(stamp, tracks)
        series.take(stamp * NS, own)
        found.append([] if own is None else series.renumber(own).track_id.tolist())
    return found, series


def test_tracks_that_go_on_or_come_back_are_of_one_series():
    found, _ = followed(
        (0, {1: 0.0, 2: 9e3}), (4, {1: 800.0, 3: 50e3}), (8, {}), (12, {4: 0.0}), (16, {4: 800.0})
    )
    assert found == [[1, 2], [1, 3], [], [4], [4]]
    found, _ = followed((0, {1: 0.0, 2: 9e3}), (4, {2: 9.8e3}), (8, {1: 1.6e3, 2: 10.6e3}))
    assert found == [[1, 2], [2], [1, 2]]


def test_numbers_found_elsewhere_are_of_another_series():
    found, series = followed(
        (0, {1: 0.0, 2: 9e3}), (4, {}), (8, {1: -40e3}), (12, {1: -39e3, 2: 0.0})
    )
    assert found == [[1, 2], [], [SERIES + 1], [SERIES + 1, SERIES + 2]]
    # Smoothed estimates are distinguished by their stamp.
    assert series.renumber(estimates(0, {2: 9e3})).track_id.tolist() == [2]
    assert series.renumber(estimates(4, {1: -41e3})).track_id.tolist() == [SERIES + 1]
    found, _ = followed((0, {1: 0.0}), (4, {1: -40e3}), (8, {1: -39e3}))
    assert found == [[1], [SERIES + 1], [SERIES + 1]]


def test_single_tracks_that_leap_or_are_fast_begin_no_series():
    found, _ = followed((0, {1: 0.0, 3: 20e3, 4: 40e3}), (4, {1: 0.8e3, 2: 20.8e3, 3: 40.8e3}))
    assert found == [[1, 3, 4], [SERIES + 1, SERIES + 2, SERIES + 3]]
    found, _ = followed((0, {1: 0.0, 2: 20e3, 3: 40e3}), (4, {1: 0.8e3, 2: 20.8e3, 3: 80e3}))
    assert found == [[1, 2, 3], [1, 2, 3]]
    found, _ = followed((0, {1: 0.0}), (60, {1: 12e3}))
    assert found == [[1], [1]]


def test_series_are_kept_over_moments_and_forgotten_after_long():
    found, _ = followed((0, {1: 0.0}), (4, None), (8, {1: 1.6e3}))
    assert found == [[1], [], [1]]
    found, _ = followed((0, {1: 0.0}), (4, None), (64, None), (68, {1: 1.6e3}))
    assert found == [[1], [], [], [SERIES + 1]]
    late = round(KEPT_S) + 100
    found, series = followed((0, {1: 0.0}), (4, {}), (8, {1: -40e3}), (late, {1: -40e3}))
    assert found[-1] == [SERIES + 1]
    assert series.renumber(estimates(late, {1: 0.0})).track_id.tolist() == [SERIES + 1]
