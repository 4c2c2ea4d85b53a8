import estimate_sets
import numpy as np
import pytest

from phd_jdtc_ros.core.arrays import read_only, sum_by
from phd_jdtc_ros.core.types import Detections


def estimates(weight):
    return estimate_sets.estimates(np.zeros((len(weight), 5)), weight=np.array(weight, dtype=float))


def test_values_are_read_only_and_sums_are_by_index():
    original = np.zeros(3)
    view = read_only(original)
    with pytest.raises(ValueError, match="read-only"):
        view[0] = 1.0
    original[0] = 1.0
    assert view[0] == 1.0  # No copy
    detections = Detections(np.zeros((2, 2)), np.zeros(2))
    assert len(detections) == 2
    for array in (detections.measurement, detections.amplitude):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    found = sum_by(np.array([0, 2, 0]), np.array([1.0, 2.0, 4.0]), 4)
    np.testing.assert_array_equal(found, [5.0, 0.0, 2.0, 0.0])
    np.testing.assert_array_equal(sum_by(np.zeros(0, dtype=int), np.zeros(0), 2), [0.0, 0.0])


@pytest.mark.parametrize("measurement", [np.zeros(3), np.zeros((2, 2, 2))])
def test_detections_refuse_a_measurement_that_is_not_a_table(measurement):
    with pytest.raises(ValueError, match=r"measurement: expected shape \(M, Z\)"):
        Detections(measurement, None)


@pytest.mark.parametrize("amplitude", [np.zeros(3), np.zeros((2, 1))])
def test_detections_refuse_amplitudes_that_do_not_match(amplitude):
    with pytest.raises(ValueError, match=r"amplitude: expected shape \(2,\)"):
        Detections(np.zeros((2, 2)), amplitude)


def test_estimates_count_those_that_hold_two_targets():
    assert estimates([0.6, 1.5, 1.51, 2.2]).unresolved == 2
    assert len(estimates([0.6, 1.5])) == 2
