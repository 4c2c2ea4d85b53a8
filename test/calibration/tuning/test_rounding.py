import numpy as np
import pytest

from phd_jdtc_ros import Tracker


def walk(step):
    """Return positions of two targets that move slowly, rounded to a step, metres."""
    rng, time = np.random.default_rng(4), np.arange(120.0)
    x = np.concatenate([-300.0 + 4.0 * time, 200.0 - 3.0 * time]) + rng.normal(0.0, 1.0, 240)
    y = np.concatenate([50.0 + 2.0 * time, -90.0 + 3.0 * time]) + rng.normal(0.0, 1.0, 240)
    rounded = [np.rint(axis / step) * step for axis in (x, y)]
    return {"time": np.tile(time, 2), "x": rounded[0], "y": rounded[1]}


@pytest.mark.parametrize(("step", "least"), [(1e-3, 0.8), (1.0, 0.8), (20.0, 5.7)])
def test_the_noise_of_rounded_positions_is_at_least_that_of_their_rounding(step, least):
    found = Tracker().fit(walk(step)).parameters["radar.position_std"]
    assert least <= found < 3.0 * least
