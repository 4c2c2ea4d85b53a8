import numpy as np
import pytest

from phd_jdtc_ros.simulation.antenna import Antenna

ROTATION_S = 4.0016
WINDY = Antenna(bearing=1.0, wobble=0.005, wobble_period_s=700.0)
TIMES = np.linspace(0.0, 3600.0, 5000)


def test_even_antenna_turns_at_its_rate_and_back():
    for antenna in (WINDY, Antenna(bearing=2.0), Antenna(wobble=0.5, wobble_period_s=30.0)):
        turns = antenna.turns_at(TIMES, ROTATION_S)
        assert (np.diff(turns) > 0.0).all()
        np.testing.assert_allclose(antenna.times_at(turns, ROTATION_S), TIMES, atol=0.005)
    turns = Antenna(bearing=np.pi / 2.0).turns_at(TIMES, ROTATION_S)
    np.testing.assert_array_equal(turns, TIMES / ROTATION_S + 0.25)


def test_wobble_is_a_share_of_the_rate_and_even_over_its_period():
    rate = np.diff(WINDY.turns_at(TIMES, ROTATION_S)) / np.diff(TIMES)
    np.testing.assert_allclose(
        [rate.max(), rate.min()], np.array([1.005, 0.995]) / ROTATION_S, rtol=1e-5
    )
    after = WINDY.turns_at(700.0 * np.arange(6), ROTATION_S)
    np.testing.assert_allclose(np.diff(after), 700.0 / ROTATION_S)
    half = WINDY.turns_at(np.array([175.0]), ROTATION_S)[0] - after[0]
    # A quarter of a sine is ahead by its integral.
    assert half - 175.0 / ROTATION_S == pytest.approx(0.005 * 700.0 / (2.0 * np.pi) / ROTATION_S)
