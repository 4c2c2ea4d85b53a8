"""Probabilities of conflicts against closed forms and an independent Monte Carlo simulation."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from phd_jdtc_ros.core.conflicts.model import OWN, PAIR, ZONE, ConflictModel, closest_approach
from phd_jdtc_ros.core.conflicts.watch import Named, predict
from phd_jdtc_ros.core.engine import Paths
from phd_jdtc_ros.core.models.zones import Zone
from phd_jdtc_ros.core.types import Pose

# The probability is the share of the paths.
PLAIN = {"slope": 1.0, "offset": 0.0}
MODEL = ConflictModel(distance=500.0, horizon_s=300.0, paths=4000, steps=20, **PLAIN)


def straight(*starts, model=MODEL, height=math.nan):
    """Return paths at constant velocity from places and velocities, (N, 4) each."""
    times = model.interval_s * np.arange(model.steps + 1)
    place = np.full((len(starts), model.paths, model.steps + 1, 3), height)
    for row, start in enumerate(starts):
        samples = np.broadcast_to(start, (model.paths, 4))
        place[row, ..., :2] = samples[:, None, :2] + times[:, None] * samples[:, None, 2:]
    return Paths(np.arange(1, len(starts) + 1), place)


def square(x0, y0, x1, y1, name="box", kind="guard"):
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]], dtype=float)
    return Zone(name, kind, np.stack([corners[:-1], corners[1:]], axis=1))


def test_predict_agrees_with_the_closed_form_for_a_lateral_error():
    # Head on with a lateral offset of 300 m and an error of 400 m, normal: the least distance is
    # the offset itself.
    rng = np.random.default_rng(0)
    other = np.tile([3000.0, 0.0, -20.0, 0.0], (MODEL.paths, 1))
    other[:, 1] = rng.normal(300.0, 400.0, MODEL.paths)
    found = predict(0, straight([0.0, 0.0, 0.0, 0.0], other), np.ones(2), Named(), MODEL)
    expected = norm.cdf(500.0, 300.0, 400.0) - norm.cdf(-500.0, 300.0, 400.0)
    assert found.probability[0] == pytest.approx(expected, abs=0.025)
    assert found.keys == [(PAIR, 1, 2)]
    # At 500 m to the side the time is 150 s, in the middle 25 s less.
    assert 125.0 < found.time_s[0] < 150.0


def test_predict_agrees_with_a_simulation_by_small_steps():
    rng = np.random.default_rng(1)
    mean, spread = [4000.0, -3000.0, -12.0, 11.0], [300.0, 300.0, 1.5, 1.5]
    other = rng.normal(mean, spread, (MODEL.paths, 4))
    found = predict(0, straight([0.0, 0.0, 3.0, 0.0], other), np.ones(2), Named(), MODEL)
    again = rng.normal(mean, spread, (20_000, 4))
    times = np.linspace(0.0, 300.0, 1501)[:, None]
    x = again[:, 0] + times * (again[:, 2] - 3.0)
    y = again[:, 1] + times * again[:, 3]
    expected = (np.hypot(x, y) < 500.0).any(axis=0).mean()
    assert 0.2 < expected < 0.95
    assert found.probability[0] == pytest.approx(expected, abs=0.025)


@pytest.mark.parametrize(("gap", "conflicts"), [(499.0, 1), (501.0, 0)])
def test_predict_finds_what_is_too_near_between_two_points(gap, conflicts):
    # They pass within 0.2 s, in the middle between two points of the paths.
    paths = straight([0.0, 0.0, 0.0, 0.0], [15e3 * 7.5, gap, -15e3, 0.0])
    assert len(predict(0, paths, np.ones(2), Named(), MODEL)) == conflicts


def test_predict_multiplies_the_existence_and_knows_what_is_too_near_now():
    paths = straight([0.0, 0.0, 0.0, 0.0], [100.0, 0.0, 0.0, 0.0])
    found = predict(0, paths, np.array([0.5, 0.8]), Named(), MODEL)
    assert found.probability.tolist() == [pytest.approx(0.4)]
    assert found.time_s.tolist() == [0.0]


@pytest.mark.parametrize(
    ("height", "least", "conflicts"), [(0.0, 300.0, 1), (400.0, 300.0, 0), (400.0, 0.0, 1)]
)
def test_predict_takes_heights_into_account_if_asked(height, least, conflicts):
    model = ConflictModel(distance=500.0, height=least, paths=8)
    paths = straight([0.0, 0.0, 1.0, 0.0], [900.0, 0.0, -1.0, 0.0], model=model, height=0.0)
    paths.place[1, ..., 2] = height
    assert len(predict(0, paths, np.ones(2), Named(), model)) == conflicts


def test_predict_takes_unknown_heights_as_equal():
    model = ConflictModel(distance=500.0, height=300.0, paths=8)
    paths = straight([0.0, 0.0, 1.0, 0.0], [900.0, 0.0, -1.0, 0.0], model=model)
    assert len(predict(0, paths, np.ones(2), Named(), model)) == 1


def test_predict_separates_a_climb_that_is_too_late():
    # One climbs through the level of the other only after they have passed.
    model = ConflictModel(distance=500.0, height=300.0, horizon_s=300.0, paths=8)
    paths = straight([0.0, 0.0, 50.0, 0.0], [5e3, 0.0, -50.0, 0.0], model=model, height=0.0)
    paths.place[1, ..., 2] = 2000.0 - 5.0 * model.interval_s * np.arange(model.steps + 1)
    assert len(predict(0, paths, np.ones(2), Named(), model)) == 0
    paths.place[1, ..., 2] += -1700.0
    assert len(predict(0, paths, np.ones(2), Named(), model)) == 1


def test_own_ship_stands_on_and_comes_first():
    own = Pose((0.0, 0.0), 0.0, (10.0, 0.0))
    found = predict(0, straight([3000.0, 100.0, -10.0, 0.0]), np.ones(1), Named(own), MODEL)
    assert found.keys == [(OWN, 0, 1)]
    # Its course is along x, so that the track passes to port, at its nearest neither ahead nor
    # astern.
    assert found.tcpa_s[0] == pytest.approx(150.0)
    assert (found.cpa[0], found.starboard[0]) == pytest.approx((100.0, -100.0))
    assert found.ahead[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("line", "velocity", "course", "ahead", "starboard"),
    [
        ((1000.0, 1000.0), (-1.0, -1.5), (1.0, 0.0), 1, 1),  # Across the bow, from port
        ((1000.0, 1000.0), (-1.5, -1.0), (1.0, 0.0), -1, -1),  # Astern, stays to port
        ((1000.0, -1000.0), (-1.0, 1.5), (1.0, 0.0), 1, -1),  # Across the bow, from starboard
    ],
)
def test_closest_approach_is_signed_as_seen_from_the_first(
    line, velocity, course, ahead, starboard
):
    found = closest_approach(*(np.array(each) for each in (line, velocity, course)))
    assert np.sign([found.ahead, found.starboard]).tolist() == [ahead, starboard]
    assert math.hypot(found.ahead, found.starboard) == pytest.approx(found.distance)
    times = np.linspace(0.0, 2.0 * found.time_s, 100_001)[:, None]
    distances = np.hypot(*(np.array(line) + times * np.array(velocity)).T)
    assert distances.min() == pytest.approx(found.distance, rel=1e-6)


def test_closest_approach_has_no_time_without_relative_motion():
    found = closest_approach(np.array([3.0, 4.0]), np.zeros(2), np.array([1.0, 0.0]))
    assert found.distance == 5.0
    assert math.isnan(found.time_s)


def test_zone_is_entered_with_the_share_of_the_paths_that_cross_it():
    rng = np.random.default_rng(2)
    start = np.tile([0.0, 0.0, 10.0, 0.0], (MODEL.paths, 1))
    start[:, 1] = rng.normal(0.0, 200.0, MODEL.paths)
    # Thinner than the way between two points of a path.
    zones = (square(1000.0, 0.0, 1010.0, 150.0), square(-100.0, -1e4, 50.0, 1e4, "here"))
    model = ConflictModel(zones=zones, horizon_s=300.0, paths=MODEL.paths, steps=20, **PLAIN)
    found = predict(0, straight(start, model=model), np.ones(1), Named(), model)
    assert found.keys == [(ZONE, 1, 1), (ZONE, 1, 0)]
    assert found.probability.tolist() == pytest.approx(
        [1.0, norm.cdf(0.75) - norm.cdf(0.0)], abs=0.025
    )
    assert found.time_s.tolist() == pytest.approx([0.0, 100.0], abs=0.1)


def test_conflicts_of_nothing_are_empty():
    found = predict(0, straight(), np.ones(0), Named(), MODEL)
    assert len(found) == 0
    assert found.place.shape == (0, 2)


@pytest.mark.parametrize(
    ("named", "keys"),
    [
        (Named(), [(PAIR, 1, 2)]),
        (Named(friends=frozenset({2})), [(PAIR, 1, 2)]),
        (Named(friends=frozenset({1, 2})), []),
        (Named(tracks=frozenset({2}), friends=frozenset({2})), [(OWN, 0, 1)]),
        (Named(tracks=frozenset({2}), friends=frozenset({1, 2})), []),
        # The track of own ship is not in conflict with its pose.
        (Named(Pose((100.0, 0.0), 0.0), frozenset({2}), frozenset({2})), [(OWN, 0, 1)]),
    ],
)
def test_own_ship_and_friends_are_as_the_operator_says(named, keys):
    paths = straight([0.0, 0.0, 0.0, 0.0], [100.0, 0.0, 0.0, 0.0])
    assert predict(0, paths, np.ones(2), named, MODEL).keys == keys


def test_calibration_keeps_certainty_and_order():
    shares = [0.0, 0.01, 0.3, 0.5, 0.7, 0.99, 1.0]
    found = [ConflictModel().calibrated(share) for share in shares]
    assert found == sorted(found)
    assert (found[0], found[-1]) == (0.0, 1.0)
    assert found[4] == pytest.approx(1.0 / (1.0 + (3.0 / 7.0) ** 1.3 * math.exp(-0.2)))
