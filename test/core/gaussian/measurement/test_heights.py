"""Reported heights as measurements of z: the mixture with garbled ones, births, and pressure."""

import math

import dome as space
import lone
import numpy as np
import pytest
from scipy.stats import norm

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement.heights import (
    above_floor,
    update_heights,
    without_unlikely,
)
from phd_jdtc_ros.core.sensors.gaussians import (
    SPAN,
    UNKNOWN_STD,
    Air,
    Births,
    HeightPrior,
    Heights,
    PlanePlots,
)
from phd_jdtc_ros.core.snapshot import Snapshot
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.types import Detections

SIZE = len(SPATIAL)
Z, VZ = SPATIAL.vertical
WITH_HEIGHTS = {**space.SPACE, "radar.fields.height": "height", "qnh_hpa": [1013.25, 18.0]}


def drawn(rng):
    root = rng.normal(size=(SIZE, SIZE)) * [[40.0], [5.0], [50.0], [4.0], [0.01], [60.0], [2.0]]
    return np.array([3e3, 30.0, 2e3, -20.0, 0.01, 1200.0, 3.0]), root @ root.T


@pytest.mark.parametrize("garbled", [0.0, 0.05, 0.9])
@pytest.mark.parametrize("error", [5.0, 180.0, 2000.0])
def test_update_has_the_moments_of_the_mixture_of_true_and_garbled_heights(garbled, error):
    mean, covariance = drawn(np.random.default_rng(0))
    time_s, std = 0.8, 25.0
    row = np.zeros(SIZE)
    row[[Z, VZ]] = 1.0, time_s
    variance = row @ covariance @ row + std**2
    height = Heights(garbled, np.array([row @ mean + error]), np.array([std]))
    found = update_heights(mean[None], covariance[None], height, np.array([time_s]))
    gain = covariance @ row / variance
    parts = [(1.0 - garbled) * norm.pdf(error, 0.0, math.sqrt(variance)), garbled / SPAN]
    share = np.array(parts) / sum(parts)
    means = np.stack([mean + gain * error, mean])
    covariances = np.stack([covariance - variance * np.outer(gain, gain), covariance])
    whole = share @ means
    apart = means - whole
    spread = np.tensordot(share, covariances + apart[:, :, None] * apart[:, None], axes=1)
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((found.mean[0] - whole) / scale, 0.0, atol=1e-10)
    np.testing.assert_allclose(
        (found.covariance[0] - spread) / np.outer(scale, scale), 0.0, atol=1e-9
    )
    assert found.log_likelihood[0] == pytest.approx(math.log(SPAN * sum(parts)))


def test_unknown_height_changes_nothing():
    mean, covariance = drawn(np.random.default_rng(1))
    found = update_heights(
        mean[None], covariance[None], Heights(0.01, np.full(1, np.nan), np.full(1, 7.6))
    )
    np.testing.assert_allclose(found.mean[0], mean)
    np.testing.assert_allclose(found.covariance[0], covariance)
    assert found.log_likelihood[0] == 0.0


def test_births_are_divided_by_whether_their_heights_are_garbled():
    plots = PlanePlots.of(np.array([[1e3, 2e3, 900.0]] * 3), np.tile(1e4 * np.eye(3), (3, 1, 1)))
    births = Births(np.arange(3), np.ones(3), plots)
    found = Heights(0.2, np.array([950.0, np.nan, 9e3]), np.full(3, 10.0)).divide(births)
    assert found.row.tolist() == [0, 0, 1, 2]
    true = 0.8 * SPAN * norm.pdf(50.0, 0.0, math.hypot(100.0, 10.0))
    np.testing.assert_allclose(found.share, [true / (true + 0.2), 0.2 / (true + 0.2), 1.0, 1.0])
    gain = 1e4 / (1e4 + 100.0)
    assert found.plots.position[0, 2] == pytest.approx(900.0 + 50.0 * gain)
    assert found.plots.covariance[0, 2, 2] == pytest.approx(1e4 * (1.0 - gain))
    np.testing.assert_allclose(found.plots.position[[1, 2, 3], 2], 900.0)


def test_target_without_an_elevation_is_born_at_its_reported_height():
    (radar,) = lone.lone({**WITH_HEIGHTS, "radar.fields.elevation": ""}).model.radars
    place = np.array([[4e3, 3e3, 1800.0]])
    measured, _ = radar.linearise(place)
    measured[0, 2] = 0.0
    std = np.array([[np.nan, np.nan, UNKNOWN_STD]])
    report = Detections(measured, None, noise_std=std, z=np.array([1800.0]))
    found = radar.places_of_births(report)
    assert found.share.sum() == pytest.approx(1.0)
    best = found.share.argmax()
    assert found.share[best] == pytest.approx(0.99)
    np.testing.assert_allclose(found.plots.position[best], place[0], atol=1e-6)
    assert math.sqrt(found.plots.covariance[best, 2, 2]) == pytest.approx(7.6)
    # The others are the cells of the prior; a height above the detection's range is garbled.
    assert len(found.share) == 7
    above = radar.places_of_births(report.changed(z=np.array([12e3])))
    assert len(above.share) == 6
    assert above.share.sum() == pytest.approx(1.0)


def test_pressure_altitude_is_that_of_the_standard_atmosphere():
    assert Air.of(1013.25, 0.0) == (0.0, 0.0)
    # A millibar more is 27 to 28 feet less at sea level (ICAO Doc 7488).
    above, std = Air.of(1014.25, 10.0)
    assert above == pytest.approx(-27.3 * 0.3048, abs=0.1)
    assert std == pytest.approx(-10.0 * above, rel=1e-2)


@pytest.mark.parametrize("seed", [20, 21])
def test_heights_and_elevations_agree_once_the_pressure_is_learned(seed):
    config, rng, above = lone.lone(WITH_HEIGHTS), np.random.default_rng(seed), -120.0
    (radar,) = config.model.radars
    truth, engine, errors = space.paths(config, rng), new_engine(config), []
    assert engine.forward.factors.pressure.std == pytest.approx(150.0, rel=0.01)
    for index, state in enumerate(truth):
        detected = state[rng.random(len(state)) < 0.9]
        height = detected[:, Z] + above + 7.6 * rng.standard_normal(len(detected))
        draw = rng.random(len(detected))
        height = np.where(draw < 0.02, rng.uniform(0.0, SPAN, len(draw)), height)
        height[draw > 0.7] = np.nan
        report = space.seen(radar, detected, rng, missing=0.3).changed(z=height)
        step = engine.step(space.scan(index, report))
        if index >= 10:
            found = step.filtered[0]
            apart = np.hypot(*(found.position[:, None] - state[:, [0, 2]]).T).T.argmin(axis=1)
            errors += list(found.state[:, Z] - state[apart, Z])
    pressure = engine.forward.factors.pressure
    assert abs(pressure.mean - above) < 3.0 * pressure.std < 15.0
    # An elevation alone is worth 73 m here.
    assert np.sqrt(np.mean(np.square(errors))) < 10.0
    assert step.filtered[0].pressure_above == pressure.mean
    # Heights have the uncertainty of the pressure in common.
    assert (step.filtered[0].covariance[:, Z, Z] > pressure.std**2).all()


def test_two_radars_share_the_pressure_that_one_of_them_can_see():
    given = {
        **space.TWO_SLANT_RANGES,
        "radar.fields.elevation": "elevation",
        "radar.fields.height": "height",
        "other.fields.height": "height",
    }
    config, rng, above = lone.lone(given), np.random.default_rng(4), 90.0
    first, second = config.model.radars
    engine, truth = new_engine(config), space.paths(config, rng, targets=10, scans=12)
    for index, state in enumerate(truth):
        reports = [space.seen(radar, state, rng) for radar in (first, second)]
        heights = (state[:, Z] + above + 7.6 * rng.standard_normal((2, len(state)))).tolist()
        engine.step(
            space.scan(
                index,
                *(own.changed(z=np.array(z)) for own, z in zip(reports, heights, strict=True)),
            )
        )
    own, others = (engine.forward.factors.by_sensor[name][-1] for name in ("radar", "other"))
    assert (own.mean, own.std) == (others.mean, others.std)
    assert abs(own.mean - above) < 3.0 * own.std < 30.0


def test_positions_with_heights_are_tracked_in_space():
    given = {
        "state": "space",
        "height_prior": [5.0, 20.0],
        "radar.kind": "position",
        "radar.area": [-200.0, -200.0, 200.0, 200.0],
        "radar.position_std": 0.4,
        "radar.position": [10.0, 5.0, 2.0],
        "detection_births.rates": [0.1],
        "detection_births.std": [10.0, 2e-3],
        "interval_s": 0.1,
        "radar.detection_probability": 0.95,
        "radar.clutter_rate": 1.0,
    }
    table = {**lone.GIVEN, **given}
    table = {name: value for name, value in table.items() if name != "radar.max_range"}
    config, rng = lone.inner.resolve(table), np.random.default_rng(6)
    (lidar,) = config.model.radars
    state = np.zeros((4, SIZE))
    state[:, [0, 2, Z]] = rng.uniform([-50.0, -50.0, 0.0], [50.0, 50.0, 12.0], (4, 3))
    # Two that stand one above the other, and one without a height.
    state[1, [0, 2]], state[:, VZ] = state[0, [0, 2]] + 2.0, [0.5, 0.0, -0.3, 0.0]
    engine, squares = new_engine(config), []
    for index in range(60):
        measured = lidar.linearise(state[:, [0, 2, Z]])[0] + 0.4 * rng.standard_normal((4, 2))
        z = state[:, Z] + 0.4 * rng.standard_normal(4)
        z[3] = np.nan
        found = engine.step(space.scan(0.1 * index, Detections(measured, None, z=z))).filtered[0]
        if index > 20:
            assert len(found) == 4
            apart = np.hypot(*(found.position[:, None] - state[:, [0, 2]]).T).T
            near = apart.argmin(axis=1)
            unknown = near == 3
            assert np.isnan(found.attributes.height[unknown, 0]).all()
            error = found.state[~unknown, Z] - state[near[~unknown], Z]
            squares += list(error**2 / found.covariance[~unknown, Z, Z])
        state[:, Z] += 0.1 * state[:, VZ]
    assert 0.5 < np.mean(squares) < 1.5


def test_learned_pressure_is_stored_and_read():
    config = lone.lone(WITH_HEIGHTS)
    (radar,) = config.model.radars
    engine, state = new_engine(config), space.paths(config, np.random.default_rng(0))[0]
    report = space.seen(radar, state, np.random.default_rng(1)).changed(z=state[:, Z] + 50.0)
    engine.step(space.scan(0, report))
    found = engine.forward.factors.pressure
    assert found.variance > 0.0
    snapshot = Snapshot(None)
    engine.forward.factors.to_snapshot(config.model.radars, snapshot)
    again = new_engine(config).forward.factors.restored(snapshot, config.model.radars).pressure
    assert (again.mean, again.std, again.stamp_ns) == (found.mean, found.std, found.stamp_ns)


@pytest.mark.parametrize("height", [30.0, -20.0, -90.0])
def test_density_below_the_floor_is_cut_off(height):
    rng, dynamics = np.random.default_rng(9), Dynamics(lone.lone(space.SPACE).model)
    mean, covariance = drawn(rng)
    mean[Z] = height
    before = lone.mixture_of(dynamics, [(0.8, mean, np.ones(SIZE))])
    before = before.changed(
        mean=np.broadcast_to(mean, before.mean.shape),
        covariance=np.broadcast_to(covariance, before.covariance.shape),
    )
    after = above_floor(before, 0.0)
    states = rng.multivariate_normal(mean, covariance, 400_000, method="cholesky")
    kept = states[states[:, Z] > 0.0]
    share = len(kept) / len(states)
    assert after.sums.mass[0] == pytest.approx(0.8 * min(2.0 * share, 1.0), rel=0.02)
    std = np.sqrt(np.diag(covariance))
    error = 4.0 / math.sqrt(len(kept)) + 1e-3
    np.testing.assert_allclose(after.mean[0, 0] / std, kept.mean(axis=0) / std, atol=error)
    np.testing.assert_allclose(
        after.covariance[0, 0] / np.outer(std, std),
        np.cov(kept.T) / np.outer(std, std),
        atol=2.0 * error,
    )


def test_density_above_the_floor_stays():
    dynamics = Dynamics(lone.lone(space.SPACE).model)
    mean, _ = drawn(np.random.default_rng(9))
    before = lone.mixture_of(dynamics, [(0.8, mean, np.ones(SIZE))])
    assert above_floor(before, 0.0) is before
    # Where an elevation is measured, the floor is that of new targets alone.
    assert lone.lone(space.SPACE).model.floor == -math.inf
    assert lone.lone(space.TWO_SLANT_RANGES).model.floor == 0.0
    assert lone.lone().model.floor == -math.inf


def test_mirror_image_below_the_ground_does_not_live():
    config, rng = lone.lone(space.TWO_SLANT_RANGES), np.random.default_rng(11)
    state = np.zeros((1, SIZE))
    state[0] = [4500.0, -40.0, 5000.0, 25.0, 0.0, 1500.0, 3.0]
    engine = new_engine(config)
    for index in range(25):
        reports = [space.seen(radar, state, rng) for radar in config.model.radars]
        found = engine.step(space.scan(index, *reports)).filtered[0]
        assert (found.state[:, Z] > -50.0).all()
        state[:, [0, 2, Z]] += state[:, [1, 3, VZ]]
    assert len(found) == 1


@pytest.mark.parametrize(
    ("height", "share"), [(-300.0, 0.0), (50e3, 0.0), (0.0, 1.0), (800.0, 1.0)]
)
def test_only_unseen_targets_under_the_ground_or_above_all_are_dropped(height, share):
    dynamics, prior = Dynamics(lone.lone(space.SPACE).model), HeightPrior(1500.0, 1000.0, 0.0)
    mean = np.array([3e3, 0.0, 2e3, 0.0, 0.0, height, 0.0])
    before = lone.mixture_of(dynamics, [(0.8, mean, np.full(SIZE, 30.0))])
    after = without_unlikely(before, np.array([True]), prior)
    assert after.sums.mass[0] == pytest.approx(0.8 * share, abs=1e-6)
    np.testing.assert_array_equal(after.mean, before.mean)
    assert without_unlikely(before, np.array([False]), prior) is before
