import pytest

from phd_jdtc_ros.nodes.tracker.health import Load


def test_load_is_the_share_of_the_window_that_was_worked():
    load = Load(10.0)
    assert load.share(100.0) == 0.0
    load.add(100.0, 101.0)
    load.add(104.0, 106.0)
    assert load.share(106.0) == pytest.approx(0.3)
    assert load.worked_s == 3.0
    load = Load(10.0)
    load.add(100.0, 104.0)
    assert load.share(112.0) == pytest.approx(0.2)
    assert load.share(114.0) == 0.0
    assert load.worked_s == 4.0
    load = Load(10.0)
    load.add(100.0, 130.0)
    assert load.share(130.0) == 1.0
