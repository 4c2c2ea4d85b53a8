"""The gated, cached kernel against the equations written out in full."""

from dataclasses import replace

import numpy as np
import pytest
from paper_room import particles, small
from scenes import gaussian_cloud, short_scenario

from phd_jdtc_ros.core.phd import kernel as backward_kernel
from phd_jdtc_ros.core.phd.particle_filter import ParticleFilter
from phd_jdtc_ros.core.phd.particles import Particles
from phd_jdtc_ros.core.phd.smoothing import (
    backward_step,
    bernoulli_death_term,
    printed_death_term,
)
from phd_jdtc_ros.simulation.simulate import simulate

DEATH_TERMS = {"bernoulli": bernoulli_death_term, "printed": printed_death_term}
SPARSE_BUDGET = {
    "particles": [80, 16],
    "budget.least": 10,
    "spawning.particles_per_target": 30,
}


def gaussian(offset, covariance):
    """Return the density of every row of `offset`."""
    square = (offset * np.linalg.solve(covariance, offset.T).T).sum(axis=1)
    _, log_determinant = np.linalg.slogdet(2.0 * np.pi * covariance)
    return np.exp(-0.5 * (square + log_determinant))


def dense_kernels(earlier, later, model, dt):
    """Return K[q, s] and mu[q], without gates, caches or whitening."""
    modes = model.modes
    share = dt / modes.interval_s
    switching, survival = modes.transition(dt), modes.survival(dt)
    kernel = np.zeros((len(later), len(earlier)))
    mu = np.zeros(len(later))
    for q in range(len(later)):
        mode = later.mode[q]
        motion = modes.motions[mode]
        support = list(motion.support)
        offset = (later.state[q] - motion.mean(earlier.state, dt))[:, support]
        moved = gaussian(offset, motion.noise_covariance(dt))
        kernel[q] = survival[earlier.mode] * switching[earlier.mode, mode] * moved
        beside = gaussian(offset, np.diag(model.spawn.std[support] ** 2))
        spawned = share * model.spawn.rate * model.spawn.transition[earlier.mode, mode] * beside
        born = sum(
            share
            * term.rate[mode]
            * gaussian(
                (later.state[q : q + 1] - term.mean)[:, support], np.diag(term.std[support] ** 2)
            )[0]
            for term in model.births
        )
        mu[q] = born + (earlier.weight * (kernel[q] + spawned)).sum()
    return kernel, mu


def stored_run(config, stamps_s, seed, start=None):
    """Return the stored sets of a short run with unequal intervals, and those intervals."""
    recursion = ParticleFilter(config.model, config.budget, seed, None, None)
    stored = [Particles.empty(5) if start is None else start]
    intervals = np.diff(stamps_s, prepend=-4.0)
    simulated = simulate(short_scenario(len(stamps_s)), seed)
    for (_, scan), dt in zip(simulated, intervals, strict=True):
        stored.append(recursion.step(stored[-1], scan, dt, linked=False).stored)
    return (stored[1:], intervals[1:]) if start is None else (stored, intervals)


def wide_cloud():
    """Return a set about the first target so dense that each later row has many ancestors."""
    rng = np.random.default_rng(7)
    mode = rng.integers(0, 4, 200)
    before = [-10e3 - 4.0 * 36.0, 36.0, 10e3 + 4.0 * 44.0, -44.0, 0.0]
    state = gaussian_cloud(rng, 200, before, [10.0, 2.0, 10.0, 2.0, 5e-3])
    state[mode % 2 == 0, 4] = 0.0
    return particles(state, np.full(200, 0.005), mode=mode)


@pytest.fixture(scope="module", autouse=True)
def every_partner():
    """Keep all pairs, whatever their number; thinning is tested in test_kernel_thinning."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(backward_kernel, "MAX_PAIRS_PER_ROW", 1_000_000)
        yield


@pytest.fixture(scope="module", params=["reference", "much-spawn", "wide-cloud"])
def run(request):
    given, start = {}, None
    if request.param == "much-spawn":
        given = {"spawn.rate": 0.2}
    if request.param == "wide-cloud":
        # Births inside the set, so that they explain a share of its rows.
        given = {
            "start_1.velocity": [36.0, -44.0],
            "start_1.std": [20.0, 4.0, 1e-3],
            "start_1.rates": [0.5, 0.5],
        }
        start = wide_cloud()
    config = small({**SPARSE_BUDGET, **given})
    # Scans do not come at exactly the nominal interval, here 4, 6, 5 and 6.5 s.
    stored, intervals = stored_run(config, [0.0, 6.0, 11.0, 17.5], seed=2, start=start)
    steps = list(zip(stored[:-1], stored[1:], intervals, strict=True))
    links = [backward_kernel.build(a, b, config.model, dt) for a, b, dt in steps]
    dense = [dense_kernels(a, b, config.model, dt) for a, b, dt in steps]
    return config.model, stored, intervals, links, dense


def assert_weights_equal(found, expected):
    """Total mass alone would hide wrong weights, as mu normalises itself: compare each."""
    total = expected.sum()
    matter = expected > 1e-9 * total
    np.testing.assert_allclose(found[matter], expected[matter], rtol=1e-3)
    assert np.abs(found - expected).sum() <= 1e-5 * total


@pytest.mark.parametrize("name", sorted(DEATH_TERMS))
def test_backward_steps_equal_the_dense_equations(run, name):
    _, stored, _, links, dense = run
    found = expected = stored[-1].weight
    for earlier, link, (kernel, mu) in zip(stored[-2::-1], links[::-1], dense[::-1], strict=True):
        assert link.orphans == 0
        # Both from the same later weights, so that errors do not accumulate over steps.
        backward = kernel.T @ (found / np.where(mu > 0.0, mu, np.inf))
        parts = earlier.components.toarray()
        death = 1.0 - link.survival
        if name == "printed":
            factor = np.ones(parts.shape[1])
        else:
            alive = np.minimum(parts.T @ backward, 1.0)
            mass = np.maximum(parts.sum(axis=0), 1.0)
            factor = (1.0 - alive) / (1.0 - parts.T @ link.survival / mass)
        expected = earlier.poisson * (backward + death)
        expected = expected + (parts * (backward[:, None] + np.outer(death, factor))).sum(axis=1)
        # Only the weights of the later set matter.
        later = particles(np.zeros((len(found), 5)), found)
        smoothed = backward_step(earlier, link, later, DEATH_TERMS[name])
        assert_weights_equal(smoothed.weight, expected)
        found = smoothed.weight


@pytest.mark.parametrize("rate", [0.0, 0.01])
def test_build_gives_an_orphan_to_its_parent(rate):
    model = replace(small({"spawn.rate": rate}).model, births=())
    state = np.zeros((2, 5))
    state[1, 0] = 100.0
    earlier = particles(state, [0.5, 0.25])
    far = np.array([[4000.0, 0.0, 3000.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0]])
    later = replace(particles(far, [0.2, 0.4]), parent=np.array([1, 0]))
    link = backward_kernel.build(earlier, later, model, 6.0)
    assert link.orphans == 1
    backward = link.ratio @ later.weight
    assert backward[1] * earlier.weight[1] == pytest.approx(0.2, rel=1e-9)


def test_build_gives_orphans_among_many_rows_to_their_parents():
    # Displaced rows keep only the pair with their parent; those of other rows must not change.
    model = replace(small().model, births=())
    rng = np.random.default_rng(5)
    count = 3000
    start = gaussian_cloud(rng, count, [0.0, 30.0, 0.0, -20.0, 0.0], [300.0, 5.0, 300.0, 5.0, 0.0])
    earlier = particles(start, rng.uniform(0.5, 1.5, count) / count)
    parent = rng.integers(0, count, count)
    moved = model.modes.motions[0].mean(start[parent], 6.0)
    moved[:, :4] += rng.standard_normal((count, 4)) * [2.0, 1.0, 2.0, 1.0]
    later = replace(particles(moved, np.full(count, 1.0 / count)), parent=parent)
    lost = np.sort(rng.choice(count, 40, replace=False))
    far = moved.copy()
    far[lost, 0] += 5000.0 * np.arange(1, 41)
    plain = backward_kernel.build(earlier, later, model, 6.0)
    link = backward_kernel.build(earlier, replace(later, state=far), model, 6.0)
    assert (plain.orphans, link.orphans) == (0, 40)
    columns = link.ratio.tocsc()
    for row in lost:
        one = slice(columns.indptr[row], columns.indptr[row + 1])
        assert columns.indices[one].tolist() == [parent[row]]
        assert columns.data[one] * earlier.weight[parent[row]] == pytest.approx(1.0, rel=1e-12)
    others = np.setdiff1d(np.arange(count), lost)
    difference = abs(link.ratio.tocsc()[:, others] - plain.ratio.tocsc()[:, others])
    assert difference.max() <= 1e-4 * plain.ratio.max()


def test_build_leaves_a_birth_out_of_reach_without_a_parent():
    model = small().model
    earlier = particles(np.zeros((1, 5)), [1.0])
    later = particles(model.births[0].mean[None], [0.3])
    link = backward_kernel.build(earlier, later, model, 6.0)
    assert link.orphans == 0
    assert (link.ratio @ later.weight).tolist() == [0.0]


def test_build_to_or_from_an_empty_set_has_no_pairs():
    model = small().model
    later = particles(np.zeros((3, 5)), [0.1, 0.1, 0.1])
    link = backward_kernel.build(Particles.empty(5), later, model, 6.0)
    assert link.ratio.shape == (0, 3)
    assert len(link.ratio @ later.weight) == 0
    earlier = particles(np.zeros((3, 5)), [0.1, 0.1, 0.1])
    link = backward_kernel.build(earlier, Particles.empty(5), model, 6.0)
    np.testing.assert_array_equal(link.ratio @ np.zeros(0), np.zeros(3))
