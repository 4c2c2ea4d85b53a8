"""Newborn Gaussians, and the iterated update of pairs of Gaussians and detections."""

from dataclasses import replace

import numpy as np
import pytest
from lone import MEAN, SIZE, STD, TWO_MOTIONS, lone, mixture_of
from scipy.stats import norm

from phd_jdtc_ros.core.gaussian.algebra import kalman, range_rate
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement import newborn as newborn_module
from phd_jdtc_ros.core.gaussian.measurement.iterated_update import coarse_further, iterated_update
from phd_jdtc_ros.core.gaussian.measurement.newborn import newborn_mixture
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.models.detection_birth import Newborn
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import Measured, WeightedGaussians
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections

BIRTHS = {"detection_births.rates": [0.05], "radar.clutter_rate": 2.0}
# Places to which the direction is well known: the range rate tells of the velocity alone.
PLACES = np.array([[6e3, 0.8], [4e3, -2.0], [9e3, 3.0]])
CONFIG = lone(
    {
        **TWO_MOTIONS,
        "radar.fields.range_rate": "range_rate",
        "radar.range_rate_std": 0.5,
        "radar.range_rate_ambiguity": 0.0,
    }
)
(RADAR,) = CONFIG.model.radars
# Hypotheses and detections, some of them in several pairs.
ROW, COLUMN = np.array([0, 2, 1, 2, 0]), np.array([1, 0, 2, 2, 0])


def rated(velocity_std, ambiguity, std=0.1):
    """Return a configuration with births at detections that have range rates."""
    return lone(
        {
            **TWO_MOTIONS,
            **BIRTHS,
            "detection_births.std": [velocity_std, 2e-3],
            "radar.fields.range_rate": "range_rate",
            "radar.range_rate_std": std,
            "radar.range_rate_ambiguity": ambiguity,
        }
    )


def born(config, detections, mass=None):
    """Return the mixture of targets born at these detections, with origins from 100 on."""
    classes = len(config.model.modes.classes)
    mass = np.full((len(detections), classes), 0.3) if mass is None else np.asarray(mass)
    newborn = Newborn(View.of(config.model.radars[0], detections), mass, np.arange(len(mass)))
    return newborn_mixture(newborn, Dynamics(config.model), 100)


# The noise of the detections is less or more than the spread of velocities, and than 1 m/s.
@pytest.mark.parametrize(
    ("velocity_std", "std", "ambiguity"),
    [(12.0, 0.5, 24.0), (12.0, 30.0, 25.0), (0.05, 0.3, 0.25), (0.4, 0.5, 0.6)],
)
def test_newborns_are_shared_among_probable_folds_of_range_rates(velocity_std, std, ambiguity):
    config = rated(velocity_std, ambiguity, ambiguity / 8.0)
    rate = ambiguity * np.array([0.3, -0.1, 0.45])
    seen = Detections(PLACES, None, range_rate=rate, range_rate_std=[std] * 3)
    found = born(config, seen, [[0.3], [0.02], [0.7]])

    folds = rate[:, None] + ambiguity * np.arange(-40, 41)
    share = norm.pdf(folds, 0.0, np.hypot(velocity_std, std))
    share /= share.sum(axis=1, keepdims=True)
    share = np.where(share >= newborn_module.LEAST_FOLD, share, 0.0)
    share /= share.sum(axis=1, keepdims=True)
    gain = velocity_std**2 / (velocity_std**2 + std**2)
    for row, mass in enumerate((0.3, 0.02, 0.7)):
        own = np.flatnonzero(found.row_label == 100 + row)
        toward = PLACES[row, 1] + config.model.radars[0].yaw
        radial = found.mean[own, 0][:, [1, 3]] @ [np.cos(toward), np.sin(toward)]
        expected = np.flatnonzero(share[row])
        order = np.argsort(radial)
        np.testing.assert_allclose(radial[order], gain * folds[row, expected], rtol=5e-3)
        np.testing.assert_allclose(
            found.sums.mass[own][order], mass * share[row, expected], rtol=1e-2, atol=1e-6
        )
        assert found.sums.mass[own].sum() == pytest.approx(mass, rel=1e-12)


def test_folds_that_are_as_probable_as_the_least_are_kept(monkeypatch):
    monkeypatch.setattr(newborn_module, "LEAST_FOLD", 0.5)
    config = rated(12.0, 100.0)
    # This range rate is as far from the one fold as from the other.
    found = born(config, Detections(PLACES[:1], None, range_rate=[50.0]))
    np.testing.assert_allclose(found.sums.mass, 0.15, rtol=1e-12)


def test_newborns_whose_range_rates_are_improbable_are_born_all_the_same():
    # Not one of their densities is above what doubles can hold.
    config = rated(1.0, 0.0)
    rates = np.array([0.5, 50.0, -80.0])
    found = born(config, Detections(PLACES, None, range_rate=rates))
    np.testing.assert_array_equal(found.row_label, [100, 101, 102])
    np.testing.assert_allclose(found.sums.mass, 0.3, rtol=1e-12)


def test_newborn_with_a_time_is_one_seen_then_where_it_was_before():
    config = rated(12.0, 24.0, 0.5)
    near = PLACES * [0.02, 1.0]
    rate, times = np.array([3.0, np.nan, -9.0]), np.array([0.7, 3.0, -2.0])
    then = born(config, Detections(near, None, range_rate=rate))
    found = born(config, Detections(near, None, range_rate=rate, time_s=times))
    np.testing.assert_array_equal(found.row_label, then.row_label)
    np.testing.assert_allclose(found.sums.mass, then.sums.mass, rtol=1e-9)
    for row, row_label in enumerate(found.row_label):
        back = np.eye(SIZE)
        back[[0, 2], [1, 3]] = -times[row_label - 100]
        for mode in range(2):
            np.testing.assert_allclose(found.mean[row, mode], back @ then.mean[row, mode])
            expected = back @ then.covariance[row, mode] @ back.T
            np.testing.assert_allclose(found.covariance[row, mode], expected, rtol=1e-9, atol=1e-9)


# --- Amplitudes -----------------------------------------------------------------------------------
def banded(low, high):
    """Return a configuration with two classes, one in each band."""
    kinds = {
        f"{kind}.{name}": value
        for kind, band in (("low", low), ("high", high))
        for name, value in (
            ("snr_band_db", band),
            ("survival_probability", 1.0),
            ("motions", ["cv"]),
            ("mode_transition", [1.0]),
        )
    }
    given = {
        **BIRTHS,
        "classes": ["low", "high"],
        "detection_births.rates": [0.05, 0.02],
        "amplitude": "memory",
        "radar.detection_probability": 0.0,
    }
    return lone({**given, **kinds})


def test_amplitude_tells_the_cells_of_a_class_and_not_its_probability():
    # The SNR is 11, 26 and 60 dB; the last ones are beyond all bands.
    config = banded([5.0, 15.0], [12.0, 30.0])
    dynamics = Dynamics(config.model)
    amplitude, mass = np.array([5.0, 28.0, 1000.0, 1500.0]), np.array([[0.2, 0.3]] * 4)
    seen = Detections(PLACES[[0, 1, 2, 0]], amplitude)
    found = born(config, seen, mass)
    np.testing.assert_array_equal(found.row_label, [100, 101, 102, 103])
    np.testing.assert_allclose(found.weight.sum(axis=1), mass, rtol=1e-9)
    power, of_each = np.exp(dynamics.cells.log_snr), amplitude[:, None, None]
    log_density = np.log(of_each / power) - of_each**2 / (2.0 * power)
    share = np.exp(log_density - log_density.max(axis=2, keepdims=True))
    share /= share.sum(axis=2, keepdims=True)
    np.testing.assert_allclose(found.snr, share, rtol=1e-6, atol=1e-12)


def test_newborns_join_a_single_hypothesis_in_memory_that_compiled_code_reads():
    config = banded([5.0, 15.0], [12.0, 30.0])
    found = born(config, Detections(PLACES, np.array([5.0, 28.0, 40.0])), [[0.2, 0.3]] * 3)
    single = found.take(np.array([0]))
    # The memory order of one hypothesis is ambiguous; that of the others decides in NumPy.
    single = single.changed(snr=single.snr.swapaxes(0, 1).copy().swapaxes(0, 1))
    assert Mixture.concatenate([single, found]).snr.flags.c_contiguous


def mixture():
    """Return three hypotheses whose modes are apart, with places and velocities correlated."""
    rng = np.random.default_rng(0)
    alike = mixture_of(Dynamics(CONFIG.model), [(0.5, MEAN, STD)] * 3)
    std = np.array([300.0, 20.0, 300.0, 20.0, 0.0])
    mean = alike.mean + rng.normal(0.0, std, alike.mean.shape)
    turn = np.eye(SIZE) + 2.0 * np.eye(SIZE, k=1) * np.array([0.0, 1.0, 0.0, 1.0, 0.0])
    size = rng.uniform(0.5, 1.5, (*mean.shape[:2], 1, 1))
    return alike.changed(mean=mean, covariance=size * (turn @ alike.covariance @ turn.T))


def report(times=None):
    """Return three detections near the hypotheses, with noise and range rates of their own."""
    apart = np.array([[100.0, 0.01], [-250.0, -0.02], [0.0, 0.03]])
    place = RADAR.measure(MEAN[None]) + apart
    return Detections(
        place,
        None,
        time_s=times,
        noise_std=[[50.0, 0.03], [np.nan, np.nan], [200.0, 0.002]],
        range_rate=np.array([10.0, np.nan, -30.0]),
        range_rate_std=[np.nan, 1.0, 2.0],
    )


@pytest.mark.parametrize("rated", [False, True], ids=["places", "range rates too"])
@pytest.mark.parametrize("times", [None, [0.9, -2.0, 4.0]], ids=["at the stamp", "with times"])
def test_pairs_are_where_each_detection_puts_what_flew_straight_until_then(times, rated):
    before, seen = mixture(), report(times)
    seen = seen if rated else replace(seen, range_rate=None)
    rates = View.of(RADAR, seen).range_rates
    found = iterated_update(before, ROW, COLUMN, View.of(RADAR, seen))
    # Pairs 3 and 1, in this order, and their modes; between them a hypothesis without a detection.
    pair = np.array([3, -1, 1])
    row = np.array([ROW[3], 0, ROW[1]])
    every_mean, every = found.updated_gaussians(before, row, pair)
    np.testing.assert_array_equal(every_mean[1], before.mean[0])
    np.testing.assert_array_equal(every[1], before.covariance[0])
    mean, covariance = every_mean[[0, 2]].reshape(-1, SIZE), every[[0, 2]].reshape(-1, SIZE, SIZE)
    gaussian = np.array([6, 7, 2, 3])

    usual = np.where(np.isnan(seen.noise_std), RADAR.noise_std, seen.noise_std)
    for place, one in enumerate(gaussian):
        (row, mode), z = (ROW[one // 2], one % 2), COLUMN[one // 2 : one // 2 + 1]
        fly = np.eye(SIZE)
        fly[[0, 2], [1, 3]] = 0.0 if times is None else times[z[0]]
        then = fly @ before.mean[row, mode], fly @ before.covariance[row, mode] @ fly.T
        then = then[0][None], then[1][None]
        measured = Measured(seen.measurement[z], usual[z])
        alone = kalman.innovations(WeightedGaussians.of(*then), RADAR, measured)
        log_likelihood = alone.log_likelihood[0]
        then = kalman.update(*then, RADAR, alone)
        if rated:
            rated = range_rate.update_rates(*then, RADAR, rates.take(z))
            log_likelihood += rated.log_likelihood[0]
            then = rated.mean, rated.covariance
        back = np.linalg.inv(fly)
        np.testing.assert_allclose(found.log_likelihood[one], log_likelihood, rtol=1e-9)
        np.testing.assert_allclose(mean[place], back @ then[0][0], rtol=1e-9)
        expected = back @ then[1][0] @ back.T
        std = np.sqrt(np.maximum(np.diag(expected), 1e-20))
        np.testing.assert_allclose(
            covariance[place] / np.outer(std, std), expected / np.outer(std, std), atol=1e-7
        )


def test_coarse_rates_are_the_densities_at_what_is_expected_of_each_gaussian():
    before, seen = mixture(), report()
    found = coarse_further(before, ROW, COLUMN, View.of(RADAR, seen))
    assert found.shape == (5, 2)
    for pair, (row, z) in enumerate(zip(ROW, COLUMN, strict=True)):
        for mode in range(2):
            (rate,), _, (variance,) = range_rate.expected_rates(
                before.mean[row, mode][None], before.covariance[row, mode][None], RADAR
            )
            std = np.sqrt(variance + [0.5, 1.0, 2.0][z] ** 2)
            density = 0.0 if z == 1 else norm.logpdf(seen.range_rate[z], rate, std)
            assert found[pair, mode] == pytest.approx(density, rel=1e-9)
