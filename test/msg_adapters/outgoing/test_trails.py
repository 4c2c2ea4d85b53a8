from dataclasses import replace

import numpy as np

from msg_adapters.outgoing.trails import UNSEEN_SCANS, Trails
from phd_jdtc_ros.core.types import Estimates


def found(scan, **x_of_track):
    """Return a scan's estimates: track number and x, as ``t3=10.0``."""
    size = len(x_of_track)
    state = np.zeros((size, 5))
    state[:, 0] = list(x_of_track.values())
    return Estimates(
        stamp_ns=scan,
        lag=0,
        state=state,
        covariance=np.zeros((size, 5, 5)),
        weight=np.ones(size),
        class_probability=np.ones((size, 1)),
        class_id=np.zeros(size),
        track_id=np.array([int(name[1:]) for name in x_of_track], dtype=int),
    )


def shape(trails):
    return [[(point.stamp_ns, point.state[0]) for point in trail] for trail in trails.values()]


def test_of_returns_the_latest_places_of_tracks():
    trails = Trails(5)
    assert shape(trails.of(found(1, t9=90.0, t3=30.0))) == [[(1, 30.0)], [(1, 90.0)]]
    assert shape(trails.of(found(2, t9=91.0))) == [[(1, 90.0), (2, 91.0)]]
    assert Trails(5).of(found(1, t0=1.0)) == {}
    trails = Trails(2)
    for scan in range(4):
        latest = trails.of(found(scan, t1=float(scan)))
    assert shape(latest) == [[(2, 2.0), (3, 3.0)]]
    trails, scan = Trails(5), found(1, t1=1.0)
    trails.of(scan)
    assert shape(trails.of(scan)) == [[(1, 1.0)]]


def test_of_forgets_after_a_long_gap_and_clear():
    trails = Trails(100)
    trails.of(found(0, t1=0.0))
    for scan in range(UNSEEN_SCANS):
        trails.of(found(1 + scan))
    assert len(trails.of(found(50, t1=1.0))[1]) == 2
    for scan in range(UNSEEN_SCANS + 1):
        trails.of(found(51 + scan))
    assert len(trails.of(found(99, t1=1.0))[1]) == 1
    trails = Trails(5)
    trails.of(found(1, t1=1.0))
    trails.clear()
    assert shape(trails.of(replace(found(2, t1=2.0), stamp_ns=7))) == [[(7, 2.0)]]
