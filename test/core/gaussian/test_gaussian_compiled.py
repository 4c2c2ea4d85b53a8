"""The compiled loops of the Gaussian engine do what those of NumPy do."""

from dataclasses import replace

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core import backend
from phd_jdtc_ros.core.gaussian import reduction, smoother
from phd_jdtc_ros.core.gaussian.algebra import kalman, moments
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement import gating
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.gaussian.prediction import Aged, survivors
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

pytest.importorskip("numba", reason="numba is optional: pip install '.[fast]'")

RADAR = resolve({"engine": "gaussian"}).model.radars[0]
SCALE = np.array([80.0, 9.0, 120.0, 7.0, 0.002])
FAR = 15e3


def by_both(function, *arguments):
    """Return what a function returns with the loops of NumPy, and with compiled ones."""
    found = []
    for name in (backend.NUMPY, backend.NUMBA):
        with backend.using(name):
            found.append(function(*arguments))
    return found


def assert_close(plain, compiled, rtol=1e-12):
    """Compare two results column by column, by the largest entry of each matrix or vector."""
    for one, other in zip(plain, compiled, strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(other, one, rtol=rtol, atol=rtol * np.abs(one).max(initial=1.0))


def covariances(rng, *shape):
    """Return random covariances of planar states, (*shape, 5, 5)."""
    root = rng.normal(size=(*shape, 5, 5)) + 2.0 * np.eye(5)
    return root @ root.swapaxes(-1, -2) * SCALE[:, None] * SCALE


def means(rng, *shape):
    """Return random planar states about the radar, (*shape, 5)."""
    angle = rng.uniform(-np.pi, np.pi, shape)
    mean = SCALE * rng.normal(size=(*shape, 5))
    mean[..., 0] += RADAR.position[0] + FAR * np.cos(angle)
    mean[..., 2] += RADAR.position[1] + FAR * np.sin(angle)
    return mean


def a_mixture(rng, count=200, per_target=4):
    """Return hypotheses of targets, each target's most probable first."""
    modes = 2
    weight = -np.sort(-rng.random((count // per_target, per_target)), axis=1).ravel()
    weight = weight[:, None, None] * rng.dirichlet(np.ones(modes * 2), count).reshape(-1, modes, 2)
    mean = means(rng, count // per_target, 1, 1).repeat(per_target, 1).repeat(modes, 2)
    mean = mean.reshape(count, modes, 5) + SCALE * rng.normal(size=(count, modes, 5))
    row_label = np.arange(count) // per_target
    return Mixture(row_label, 0.9 * weight / per_target, mean, covariances(rng, count, modes))


def the_dynamics():
    return Dynamics(resolve({"engine": "gaussian"}).model)


@pytest.mark.parametrize("timed", [False, True], ids=["at the stamp", "when passed"])
@pytest.mark.parametrize("iterations", [1, 5])
def test_located_and_updated_are_those_of_numpy(timed, iterations):
    rng = np.random.default_rng(1)
    mean, covariance = means(rng, 300), covariances(rng, 300)
    measurement = RADAR.measure(mean + SCALE * rng.normal(size=mean.shape))
    noise = RADAR.noise_std * rng.uniform(0.5, 2.0, measurement.shape)
    time_s = rng.uniform(-2.0, 2.0, 300) if timed else None
    given = (mean, covariance, RADAR, measurement, noise, time_s, iterations)
    plain, compiled = by_both(kalman.iterated_update, *given)
    assert_close(plain, compiled)
    assert_close(*by_both(kalman.updated, mean, covariance, RADAR, plain, time_s))


def test_located_of_a_row_does_not_depend_on_the_others(backend):
    rng = np.random.default_rng(2)
    mean, covariance = means(rng, 40), covariances(rng, 40)
    mean[0, [0, 2]] = np.asarray(RADAR.position) + 200.0  # beside the radar: slow to converge
    measurement = RADAR.measure(mean + SCALE * rng.normal(size=mean.shape))
    noise = np.tile(RADAR.noise_std, (40, 1))
    whole = kalman.iterated_update(mean, covariance, RADAR, measurement, noise)
    for row in range(40):
        one = slice(row, row + 1)
        alone = kalman.iterated_update(
            mean[one], covariance[one], RADAR, measurement[one], noise[one]
        )
        assert_close([part[one] for part in whole], alone)


def test_backward_steps_are_those_of_numpy():
    rng = np.random.default_rng(3)
    mean, covariance = means(rng, 50, 3), covariances(rng, 50, 3)
    covariance[:, 1, 4], covariance[:, 1, :, 4] = 0.0, 0.0
    transition = np.broadcast_to(np.eye(5) + 0.1 * rng.normal(size=(5, 5)), covariance.shape).copy()
    transition[:, 1, 4], transition[:, 1, :, 4] = 0.0, 0.0
    later, cross = kalman.predicted_covariance(covariance, transition, 0.1 * covariance)
    unsupported = np.zeros((3, 5))
    unsupported[1, 4] = 1.0
    given = (mean, covariance, mean + 1.0, later, cross, unsupported)
    plain, compiled = by_both(kalman.backward, *given)
    # Both lose what the inverse of such a covariance loses.
    unit = SCALE[:, None] * SCALE
    assert_close([plain[1] * unit], [compiled[1] * unit], rtol=1e-9)
    ratio = SCALE / SCALE[:, None]
    columns = [
        (found.gain * ratio, found.offset / SCALE, found.base / unit)
        for found in (plain[0], compiled[0])
    ]
    assert_close(*columns, rtol=1e-9)


def test_backward_steps_of_singular_covariances_are_those_of_numpy():
    later = np.zeros((2, 5, 5))
    later[0] = np.eye(5)
    given = (np.ones((2, 5)), later, np.ones((2, 5)), later, later, np.zeros((2, 5)))
    (plain, one), (compiled, other) = by_both(kalman.backward, *given)
    assert_close((*plain, one), (*compiled, other))


def test_moments_are_those_of_numpy():
    rng = np.random.default_rng(4)
    mean, covariance = means(rng, 30, 3), covariances(rng, 30, 3)
    share = rng.dirichlet(np.ones(3), (30, 2))
    assert_close(*by_both(moments.match_moments, share, mean, covariance))
    first = np.array([0, 1, 4, 5, 20])
    size = np.diff(np.append(first, 30))
    share = rng.random((30, 3))
    share /= np.add.reduceat(share, first).repeat(size, axis=0)
    assert_close(*by_both(moments.merge_moments, share, mean, covariance, first))


def test_same_hypotheses_are_merged_as_by_numpy():
    mixture = a_mixture(np.random.default_rng(5))
    for distance in (0.1, 2.0, 10.0):
        plain, compiled = by_both(reduction._clusters, mixture, distance)
        np.testing.assert_array_equal(plain, compiled)
        assert (plain != np.arange(len(plain))).any() or distance < 1.0


@pytest.mark.parametrize("timed", [False, True], ids=["at the stamp", "when passed"])
def test_same_detections_are_gated_as_by_numpy(timed):
    rng = np.random.default_rng(6)
    mixture = a_mixture(rng)
    true = mixture.mean[::4, 0]
    measurement = RADAR.measure(np.concatenate([true, means(rng, 100)]))
    measurement[:, 1] += rng.normal(size=len(measurement)) * RADAR.noise_std[1]
    detections = Detections(measurement, None)
    if timed:
        detections = replace(detections, time_s=rng.uniform(-2.0, 2.0, len(measurement)))
    expected = gating.Expected.of(mixture, RADAR)
    plain, compiled = by_both(gating.gate_pairs, mixture, expected, Report(RADAR, detections))
    assert len(plain[0]) > 100
    np.testing.assert_array_equal(plain[0], compiled[0])
    np.testing.assert_array_equal(plain[1], compiled[1])
    np.testing.assert_allclose(compiled[2], plain[2], rtol=1e-12)


def test_hindsight_is_that_of_numpy():
    rng = np.random.default_rng(7)
    config = resolve({"engine": "gaussian"})
    engine = new_engine(config)
    scans = [scan for _, scan in simulate(paper_scenario(config.model.radars), 0)][:12]
    for scan in scans:
        engine.step(scan)
    dynamics, earlier = engine.forward.dynamics, engine.forward.unswept[0].stored
    moved, moves = survivors([Aged(earlier, 3.0)], dynamics)
    mean = moved.mean + 0.1 * rng.normal(size=moved.mean.shape) * np.sqrt(
        np.diagonal(moved.covariance, axis1=-2, axis2=-1)
    )
    later = smoother.Later(moves, 0.9 * moved.weight, mean, 0.8 * moved.covariance)
    plain, compiled = by_both(smoother._with_hindsight, earlier, later)
    np.testing.assert_allclose(compiled.weight, plain.weight, rtol=1e-9, atol=1e-15)
    scale = np.sqrt(np.diagonal(plain.covariance, axis1=-2, axis2=-1))
    scale = np.where(scale > 0.0, scale, 1.0)
    assert_close([plain.mean / scale], [compiled.mean / scale], rtol=1e-9)
    unit = scale[..., None] * scale[..., None, :]
    assert_close([plain.covariance / unit], [compiled.covariance / unit], rtol=1e-9)


def test_estimates_of_a_scenario_are_those_of_numpy():
    config = resolve({"engine": "gaussian"})
    scans = [scan for _, scan in simulate(paper_scenario(config.model.radars), 1)][:30]

    def estimates():
        engine = new_engine(config)
        steps = [engine.step(scan) for scan in scans]
        return [one for step in steps for one in (*step.filtered, *step.smoothed)]

    plain, compiled = by_both(estimates)
    assert sum(len(one.state) for one in plain) > 100
    for one, other in zip(plain, compiled, strict=True):
        np.testing.assert_array_equal(one.track_id, other.track_id)
        np.testing.assert_array_equal(one.class_id, other.class_id)
        np.testing.assert_allclose(other.state, one.state, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(other.weight, one.weight, rtol=1e-6)
