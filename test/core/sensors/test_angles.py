import math

import numpy as np
import pytest

from phd_jdtc_ros.core.sensors.of_gaussians.angles import angle_of


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e6])
def test_angle_of_a_vector_is_the_arctangent(length):
    small = np.append(np.geomspace(1e-12, 0.1, 60), [0.0, math.atan(0.03), 0.5, 2.0, 3.0])
    for angle in np.append(small, -small):
        ahead, left = length * math.cos(angle), length * math.sin(angle)
        assert angle_of(ahead, left) == pytest.approx(math.atan2(left, ahead), rel=1e-12, abs=0.0)
    assert angle_of(0.0, 0.0) == 0.0
