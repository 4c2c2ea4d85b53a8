import numpy as np

from phd_jdtc_ros.calibration.registration.filtering import KINDS
from phd_jdtc_ros.calibration.registration.observability import analyse

COUNT = len(KINDS)


def information(*directions, known=1e6):
    """Return the information of two radars on all but some directions."""
    found = known * np.eye(2 * COUNT)
    for direction in directions:
        unit = direction / np.linalg.norm(direction)
        # Earlier information on it is removed.
        found -= np.outer(found @ unit, unit @ found) / (unit @ found @ unit)
    return found


def both(kind):
    """Return the direction of an error that is common to both radars."""
    direction = np.zeros(2 * COUNT)
    direction[[KINDS.index(kind), COUNT + KINDS.index(kind)]] = 1.0
    return direction


def test_the_reference_has_only_errors_that_are_observable():
    found = analyse(information(both("time_offset_s")), np.ones(2 * COUNT), 1)
    assert found.common == ("time_offset_s",)
    assert not found.hidden
    assert found.free.tolist() == [True] * 7 + [False]
    assert np.isfinite(found.covariance).all()
    assert found.covariance[7].tolist() == [0.0] * 8
    lacking = information(both("time_offset_s"), both("azimuth"))
    found = analyse(lacking, np.ones(2 * COUNT), 0)
    assert found.common == ("time_offset_s", "azimuth")
    assert not found.hidden
    assert np.flatnonzero(~found.free).tolist() == [2, 3]


def test_uncertain_biases_are_not_observable():
    alone = np.zeros(2 * COUNT)
    alone[COUNT + KINDS.index("range_gain")] = 1.0
    found = analyse(information(both("time_offset_s"), alone), np.ones(2 * COUNT), 0)
    assert found.common == ("time_offset_s",)
    assert found.hidden == (COUNT + 1,)
    weak = 0.5 * np.eye(2 * COUNT)
    found = analyse(weak, np.ones(2 * COUNT), 0)
    assert not found.free.any()
    assert len(found.hidden) + len(found.common) == 2 * COUNT
    assert analyse(weak, 10.0 * np.ones(2 * COUNT), 0).free.sum() == 2 * COUNT - 1
