import numpy as np
import pytest
from numpy.testing import assert_allclose

from phd_jdtc_ros.core.sensors.bias import NO_BIAS, SensorBias
from phd_jdtc_ros.core.types import Detections

BIAS = SensorBias(80.0, 2e-3, np.radians(0.3), 0.5)
FOUND = Detections(np.array([[1000.0, 3.14], [90e3, -3.14]]), None, np.array([-1.0, 0.0]))


def test_errors_that_are_added_are_those_that_are_removed():
    stamp_ns, wrong = BIAS.apply_to(10**12, FOUND)
    assert stamp_ns == 10**12 + 5 * 10**8
    assert_allclose(wrong.measurement[:, 0], [1082.0, 90e3 * 1.002 + 80.0])
    # Beyond half a turn it is counted from the other side.
    assert_allclose(wrong.measurement[0, 1], 3.14 + np.radians(0.3) - 2 * np.pi)
    assert wrong.time_s is not None
    again_ns, right = BIAS.remove_from(stamp_ns, wrong)
    assert again_ns == 10**12
    assert_allclose(right.measurement, FOUND.measurement, rtol=1e-12)


def test_no_errors_leave_a_report_as_it_is():
    assert NO_BIAS.remove_from(5, FOUND) == (5, FOUND)
    assert NO_BIAS.remove_from(5, FOUND)[1] is FOUND
    assert NO_BIAS.apply_to(5, FOUND)[1] is FOUND


def test_a_range_is_not_below_zero():
    near = Detections(np.array([[20.0, 0.0]]), None)
    assert BIAS.remove_from(0, near)[1].measurement[0, 0] == 0.0


@pytest.mark.parametrize("first", [NO_BIAS, BIAS, SensorBias(-30.0, -1e-3, 0.1, -2.0)])
def test_errors_that_are_left_after_others_are_removed_add_up(first):
    later = SensorBias(10.0, 1e-3, 0.02, 0.25)
    # Who has the first errors beside the later ones is right once both are removed.
    stamp_ns, found = first.apply_to(*later.apply_to(10**12, FOUND))
    whole_ns, whole = first.followed_by(later).remove_from(stamp_ns, found)
    assert whole_ns == 10**12
    assert_allclose(whole.measurement, FOUND.measurement, rtol=1e-9)
