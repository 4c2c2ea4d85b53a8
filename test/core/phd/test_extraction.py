import numpy as np
import pytest
from paper_room import particles, small

from phd_jdtc_ros.core.phd.extraction import (
    clusters,
    components,
    estimates,
    moments_of_particles,
)
from phd_jdtc_ros.core.phd.particles import Particles

EXTRACTIONS = {"components": components, "clusters": clusters}
MODES = small().model.modes  # Flat modes 0, 1 are class 0; 2, 3 class 1


def extract(phd, method=components, lag=0, threshold=0.5):
    groups = method(phd, MODES, threshold, np.random.default_rng(0))
    return estimates(groups, phd.mode, MODES, moments_of_particles(phd, MODES), 42, lag)


def two_clouds(weight=(1.0, 1.0), mode=(0, 2), count=200):
    """Return two targets 5 km apart, components by one detection each."""
    rng = np.random.default_rng(1)
    state = rng.normal(0.0, 50.0, (2 * count, 5))
    state[count:, 0] += 5000.0
    components = np.zeros((2 * count, 2))
    components[:count, 0] = weight[0] / count
    components[count:, 1] = weight[1] / count
    return particles(state, np.zeros(2 * count), mode=np.repeat(mode, count), components=components)


def test_components_report_detections():
    state = np.arange(20.0).reshape(4, 5)
    components = [[0.3, 0.2, 0.0], [0.3, 0.0, 0.0], [0.0, 0.29, 0.5], [0.0, 0.0, 0.4]]
    found = extract(particles(state, np.zeros(4), components=components))
    np.testing.assert_allclose(found.weight, [0.6, 0.9])
    np.testing.assert_allclose(found.state[0], (state[0] + state[1]) / 2.0)
    np.testing.assert_allclose(found.state[1], (5.0 * state[2] + 4.0 * state[3]) / 9.0)
    np.testing.assert_array_equal(found.track_id, 0)


def test_components_report_the_unexplained_mass_of_an_origin_and_class():
    # Origin 4 of class 0 exceeds one half, split over its two motions; the same origin's other
    # class and another origin do not.
    phd = particles(
        np.zeros((4, 5)),
        [0.3, 0.3, 0.4, 0.45],
        mode=np.array([0, 1, 2, 0]),
        origin=np.array([4, 4, 4, 9]),
    )
    found = extract(phd)
    np.testing.assert_allclose(found.weight, [0.6])
    np.testing.assert_array_equal(found.class_id, [0])


@pytest.mark.parametrize(("threshold", "found"), [(0.5, 2), (0.6, 1), (0.95, 0)])
def test_components_report_what_exceeds_the_threshold(threshold, found):
    phd = particles(np.zeros((2, 5)), np.zeros(2), components=[[0.55, 0.0], [0.0, 0.9]])
    assert len(extract(phd, threshold=threshold)) == found


def test_components_report_masses_beyond_one_once():
    phd = particles(np.zeros((1, 5)), [0.4], components=[[0.4]])
    assert len(extract(phd)) == 0
    found = extract(two_clouds(weight=(1.7, 0.9)))
    np.testing.assert_allclose(found.weight, [1.7, 0.9])
    assert found.unresolved == 1


def test_components_take_class_and_state_from_the_majority():
    state = np.zeros((3, 5))
    state[:, 0] = [100.0, 200.0, 900.0]
    phd = particles(state, np.zeros(3), mode=np.array([2, 3, 0]), components=[[0.2], [0.4], [0.25]])
    found = extract(phd)
    np.testing.assert_array_equal(found.class_id, [1])
    np.testing.assert_allclose(found.class_probability, [[0.25 / 0.85, 0.6 / 0.85]])
    np.testing.assert_allclose(found.weight, [0.85])
    # Mean and variance over class 1 only: 500/3 and the spread of 100 and 200 about it.
    mean = 500.0 / 3.0
    assert found.state[0, 0] == pytest.approx(mean)
    variance = (100.0 - mean) ** 2 / 3.0 + 2.0 * (200.0 - mean) ** 2 / 3.0
    # With shares of 1/3 and 2/3 they are 1.8 particles, beside which the noise of an interval of
    # both motions counts as two.
    noise = [MODES.motions[m].noise_covariance(MODES.interval_s)[0, 0] for m in (2, 3)]
    variance += 2.0 / 3.8 * (noise[0] + 2.0 * noise[1]) / 3.0
    assert found.covariance[0, 0, 0] == pytest.approx(variance)


def test_covariance_of_copies_of_one_particle_is_not_singular():
    motion = MODES.motions[0]
    phd = particles(np.ones((20, 5)), np.zeros(20), components=np.full((20, 1), 0.05))
    found = extract(phd)
    own = found.covariance[0][np.ix_(motion.support, motion.support)]
    assert np.linalg.eigvalsh(own).min() > 0.0


@pytest.mark.parametrize("method", list(EXTRACTIONS.values()), ids=list(EXTRACTIONS))
@pytest.mark.parametrize("phd", [Particles.empty(5), two_clouds(weight=(0.3, 0.2))])
def test_extraction_of_nothing_or_an_unlikely_target_has_the_right_shapes(phd, method):
    found = extract(phd, method, lag=3)
    assert (found.stamp_ns, found.lag, len(found)) == (42, 3, 0)
    assert found.state.shape == (0, 5)
    assert found.covariance.shape == (0, 5, 5)
    assert found.class_probability.shape == (0, 2)
    assert found.weight.shape == found.class_id.shape == found.track_id.shape == (0,)


@pytest.mark.parametrize("method", list(EXTRACTIONS.values()), ids=list(EXTRACTIONS))
@pytest.mark.parametrize("mode", [(0, 2), (1, 1)], ids=["two-classes", "one-class"])
def test_extraction_finds_two_separated_targets(method, mode):
    phd = two_clouds(mode=mode)
    found = extract(phd, method)
    order = np.argsort(found.state[:, 0])
    assert len(found) == 2
    expected = [phd.state[:200].mean(axis=0), phd.state[200:].mean(axis=0)]
    # The input of k-means is 2000 systematic draws of 200 or 400 equal particles, evenly repeated.
    np.testing.assert_allclose(found.state[order], expected, atol=1e-6)
    np.testing.assert_array_equal(found.class_id[order], MODES.class_of[list(mode)])
    np.testing.assert_allclose(found.weight, 1.0)
    one = np.cov(phd.state[:200].T, ddof=0)
    # The process noise of one interval counts as two particles.
    of_class = 2000 // mode.count(mode[0])
    motion, of_each = MODES.motions[mode[0]], 200 if method is components else of_class
    axes = np.ix_(motion.support, motion.support)
    one[axes] += 2.0 / (of_each + 2.0) * motion.noise_covariance(MODES.interval_s)
    np.testing.assert_allclose(found.covariance[order[0]], one, rtol=1e-6, atol=1e-6)


def test_clusters_round_the_mass_of_each_class():
    found = extract(two_clouds(weight=(0.8, 0.7), mode=(0, 0)), clusters)
    assert len(found) == 2  # 1.5 rounds to 2
    found = extract(two_clouds(weight=(0.7, 0.7), mode=(0, 0)), clusters)
    assert len(found) == 1
    found = extract(two_clouds(weight=(0.4, 0.6), mode=(0, 2)), clusters)
    np.testing.assert_array_equal(found.class_id, [1])


@pytest.mark.filterwarnings("ignore:One of the clusters is empty", "ignore:invalid value")
def test_clusters_survive_more_targets_than_particles():
    # All draws are of one point, so k-means must leave a cluster empty; it is no target.
    phd = particles(np.ones((1, 5)), [3.0])
    found = extract(phd, clusters)
    assert 1 <= len(found) <= 3
    assert np.isfinite(found.state).all()
    np.testing.assert_allclose(found.state, 1.0)
