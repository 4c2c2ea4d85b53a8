from dataclasses import replace

from estimate_sets import of_tracks

from phd_jdtc_ros.nodes.tracker.outputs import UNSEEN_SCANS, Trails


def found(scan, **x_of_track):
    """Return a scan's estimates: track number and x, as ``t3=10.0``."""
    return of_tracks({int(name[1:]): (x, 0.0) for name, x in x_of_track.items()}, stamp_ns=scan)


def shape(trails):
    return [[(point.stamp_ns, point.state[0]) for point in trail] for trail in trails]


def test_add_returns_the_trails_of_the_scan_by_ascending_track():
    trails = Trails(5)
    assert shape(trails.add(found(1, t9=90.0, t3=30.0))) == [[(1, 30.0)], [(1, 90.0)]]
    assert shape(trails.add(found(2, t9=91.0))) == [[(1, 90.0), (2, 91.0)]]


def test_add_leaves_out_what_has_no_track():
    assert Trails(5).add(found(1, t0=1.0)) == []


def test_add_keeps_the_latest_places_only():
    trails = Trails(2)
    for scan in range(4):
        latest = trails.add(found(scan, t1=float(scan)))
    assert shape(latest) == [[(2, 2.0), (3, 3.0)]]


def test_add_goes_on_after_a_gap_and_forgets_after_a_long_one():
    trails = Trails(100)
    trails.add(found(0, t1=0.0))
    for scan in range(UNSEEN_SCANS):
        trails.add(found(1 + scan))
    assert len(trails.add(found(50, t1=1.0))[0]) == 2
    for scan in range(UNSEEN_SCANS + 1):
        trails.add(found(51 + scan))
    assert len(trails.add(found(99, t1=1.0))[0]) == 1


def test_clear_forgets_everything():
    trails = Trails(5)
    trails.add(found(1, t1=1.0))
    trails.clear()
    assert shape(trails.add(replace(found(2, t1=2.0), stamp_ns=7))) == [[(7, 2.0)]]
