"""Estimates at common stamps, and the probabilities of confirmation and deletion."""

from dataclasses import replace

import estimate_sets
import numpy as np
import pytest
from reference import resolve
from scenes import seen_with, small

from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.targets.motion import CoordinatedTurn
from phd_jdtc_ros.core.tracks.common_stamp import Schedule, between, interpolate, predict
from phd_jdtc_ros.core.tracks.reporting_rule import rule_of
from phd_jdtc_ros.core.types import Estimates

MODES = small().model.modes
SECOND = 1_000_000_000
TURNING = CoordinatedTurn(0.0, 0.0)
MODEL = resolve({"amplitude": "band"}).model


def estimates(stamp_s, tracks, state=None, weight=0.9):
    count = len(tracks)
    if state is None:
        state = np.tile([1000.0, 100.0, 2000.0, -50.0, 0.0], (count, 1))
    return estimate_sets.estimates(
        state,
        np.diag([100.0, 4.0, 100.0, 4.0, 1e-6]),
        weight,
        stamp_ns=round(stamp_s * SECOND),
        class_probability=np.tile([0.7, 0.3], (count, 1)),
        track_id=np.array(tracks, dtype=np.int64),
    )


def moved(found, dt):
    """Return the states where their turns take them, at their stamp."""
    return replace(
        found, stamp_ns=found.stamp_ns + round(dt * SECOND), state=TURNING.mean(found.state, dt)
    )


def predicted_from(found, stamp_ns):
    return predict(found, np.full(len(found), found.stamp_ns), stamp_ns, MODES)


def interpolated(before, after, stamp_ns):
    times = tuple(np.full(len(part), part.stamp_ns) for part in (before, after))
    return interpolate(before, after, times, stamp_ns)


def test_interpolated_estimates_end_at_either_end_in_order_of_tracks():
    assert Schedule(0).between(0, 10 * SECOND) == []
    found, time_ns = Estimates.concatenate([estimates(1.0, [4, 9]), estimates(2.0, [2])], 0)
    assert found.track_id.tolist() == [2, 4, 9]
    assert time_ns.tolist() == [2 * SECOND, SECOND, SECOND]


@pytest.mark.parametrize(
    ("after", "before", "expected"),
    [(0.5, 3.5, [1, 2, 3]), (1.0, 3.0, [1, 2]), (1.1, 1.9, []), (0.0, 1.0, [0])],
)
def test_schedule_has_the_multiples_from_one_scan_until_before_the_next(after, before, expected):
    found = Schedule(SECOND).between(round(after * SECOND), round(before * SECOND))
    assert found == [second * SECOND for second in expected]


def test_predicted_moves_each_target_by_its_turn_from_its_own_time():
    found = estimates(0.0, [1], np.array([[1000.0, 100.0, 2000.0, -50.0, 0.05]]))
    later = predicted_from(found, 4 * SECOND)
    np.testing.assert_allclose(later.state, TURNING.mean(found.state, 4.0))
    # The variance is that of 10 m and of 4 s of 2 m/s, with the noise; the turn rate adds little.
    assert 100.0 + 16.0 * 4.0 < later.covariance[0, 0, 0] < 250.0
    assert later.weight[0] == pytest.approx(0.9 * 0.99 ** (4.0 / 6.0))
    assert later.stamp_ns == 4 * SECOND
    parts = [estimates(1.0, [1, 4]), estimates(2.0, [2]), estimates(5.0, [3])]
    found = predict(*Estimates.concatenate(parts, 0), 5 * SECOND, MODES)
    for part in parts:
        own = np.isin(found.track_id, part.track_id)
        alone = predicted_from(part, 5 * SECOND)
        np.testing.assert_array_equal(found.state[own], alone.state)
        np.testing.assert_allclose(found.covariance[own], alone.covariance)
        np.testing.assert_array_equal(found.weight[own], alone.weight)


def test_predicted_jacobian_is_that_of_a_straight_line_without_a_turn():
    found = estimates(0.0, [1])
    jacobian = np.eye(5)
    jacobian[0, 1] = jacobian[2, 3] = 3.0
    jacobian[0, 4], jacobian[1, 4] = -4.5 * -50.0, -3.0 * -50.0
    jacobian[2, 4], jacobian[3, 4] = 4.5 * 100.0, 3.0 * 100.0
    noise = np.zeros((5, 5))
    for motion in MODES.classes[0].motions:
        axes = np.ix_(motion.support, motion.support)
        noise[axes] += motion.noise_covariance(3.0) / 2.0
    expected = jacobian @ found.covariance[0] @ jacobian.T + noise
    later = predicted_from(found, 3 * SECOND)
    np.testing.assert_allclose(later.covariance[0], expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("turn_rate", [0.0, 0.03])
def test_interpolated_is_on_the_path_between(turn_rate):
    before = estimates(10.0, [1, 2], np.array([[0.0, 200.0, 50.0, 10.0, turn_rate]] * 2))
    after = moved(before, 4.0)
    found = interpolated(before, after, 11 * SECOND)
    expected = moved(before, 1.0)
    # A cubic is off by the fourth derivative: v w^3 T^4 / 384.
    np.testing.assert_allclose(found.position, expected.position, atol=0.01)
    np.testing.assert_allclose(found.velocity, expected.velocity, atol=0.05)


def test_interpolated_at_either_end_is_that_end():
    before = estimates(10.0, [1])
    after = replace(moved(before, 4.0), weight=np.array([0.5]))
    for end in (before, after):
        found = interpolated(before, after, end.stamp_ns)
        np.testing.assert_allclose(found.state, end.state, atol=1e-9)
        np.testing.assert_allclose(found.weight, end.weight)


def test_between_predicts_what_has_no_later_update_and_keeps_the_lag():
    first, second = estimates(10.0, [3, 5]), moved(estimates(10.0, [5]), 4.0)
    update = *Estimates.concatenate([first, second], 2), slice(1, 2), slice(2, 3)
    found = between(*update, slice(1), 12 * SECOND, 0.5, MODES)
    assert (found.track_id.tolist(), found.stamp_ns, found.lag) == ([3, 5], 12 * SECOND, 2)
    np.testing.assert_allclose(found.position, moved(first, 2.0).position, atol=1e-6)
    # The predicted covariance has grown, and the interpolated one has not.
    assert found.covariance[0, 0, 0] > found.covariance[1, 0, 0]
    assert len(between(*update, slice(1), 12 * SECOND, 0.95, MODES)) == 0


def test_between_no_updates_has_all_columns():
    empty = *Estimates.concatenate([estimates(10.0, [])], 1), *[slice(0)] * 3
    found = between(*empty, 12 * SECOND, 0.5, MODES)
    assert (len(found), found.state.shape, found.class_probability.shape) == (0, (0, 5), (0, 2))


def test_derived_thresholds_follow_from_the_detection_probability():
    rule = rule_of(MODEL, True)
    # The second class is missed by both radars with probability 0.03.
    assert rule.confirm == pytest.approx([2.0 / 3.0, 1.97 / 2.97], abs=2e-3)
    assert rule.delete == pytest.approx([1.0 / 3.0, 1.0 / 2.97], abs=2e-3)
    assert rule.hidden == pytest.approx([0.5, 0.5])
    # A target that is hardly ever detected would not be back soon.
    rare = rule_of(seen_with(MODEL, 0.05), True)
    assert rare.confirm == pytest.approx((2.0 - 0.95**2) / (3.0 - 0.95**2))
    assert rare.delete == pytest.approx(1.0 / (3.0 - 0.95**2))


def test_thresholds_bound_each_other():
    assert rule_of(MODEL, True, confirm=0.2).delete == pytest.approx([0.2, 0.2])
    assert rule_of(MODEL, True, delete=0.9).confirm == pytest.approx([0.9, 0.9])
    with pytest.raises(ConfigError, match=r"existence: \[0\.5, 0\.9\] given, the second must be"):
        resolve({"existence": [0.5, 0.9]})


def test_records_weigh_what_the_band_leaves_open_without_memory():
    rng = np.random.default_rng(0)
    low, high = MODEL.modes.classes[1].snr_band
    snr = np.exp(rng.uniform(np.log1p(low), np.log1p(high), 1_000_000)) - 1.0
    missed = (1.0 - np.exp(-0.5 * MODEL.radars[0].threshold ** 2 / (1.0 + snr))) ** 2
    expected = missed.mean() ** 2 / missed.var()
    assert rule_of(MODEL, True).record_weight[1] == pytest.approx(expected, rel=0.01)
    # A given detection probability is that of every target.
    assert np.isinf(rule_of(seen_with(MODEL, 0.9), True).record_weight).all()
    model = resolve({"amplitude": "memory"}).model
    assert np.isinf(rule_of(model, True).record_weight).all()
