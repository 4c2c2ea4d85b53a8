from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import intensity, predict, scattered, small
from scipy import sparse

from phd_jdtc_ros.configuration.engines import particle_filter
from phd_jdtc_ros.core.smc import resampling
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.smc.resampling import ParticleBudget
from phd_jdtc_ros.core.tracks.labels import LABELS_PER_SCAN

CONFIG = small({"engine": "phd"})
FILTER = particle_filter(CONFIG)
METHOD = (FILTER.corrector, FILTER.budget)
MODEL = CONFIG.model
MODES = MODEL.modes


@st.composite
def grouped_weights(draw):
    sizes = draw(st.lists(st.integers(1, 12), min_size=1, max_size=6))
    group = np.repeat(np.arange(len(sizes)), sizes)
    weight = draw(
        st.lists(st.floats(1e-6, 10.0), min_size=len(group), max_size=len(group)).map(np.array)
    )
    count = draw(st.lists(st.integers(0, 40), min_size=len(sizes), max_size=len(sizes)))
    return weight, group, np.array(count), draw(st.integers(0, 10**6))


@settings(deadline=None, max_examples=150)
@given(case=grouped_weights())
def test_systematic_copies_are_near_their_expectation_and_sum_to_the_count_of_a_group(case):
    weight, group, count, seed = case
    copies = resampling.systematic(weight, group, count, np.random.default_rng(seed))
    assert (copies >= 0).all()
    np.testing.assert_array_equal(np.bincount(group, copies, len(count)), count)
    expected = weight * (count / np.bincount(group, weight, len(count)))[group]
    # One offset per group, so the count is off by less than one; 1e-9 allows for rounding of sums.
    assert (np.abs(copies - expected) < 1.0 + 1e-9).all()


def test_systematic_is_unbiased():
    rng = np.random.default_rng(5)
    group = np.repeat([0, 1, 3], [7, 1, 12])  # group 2 is empty
    weight = rng.exponential(1.0, len(group))
    count = np.array([9, 4, 0, 5])
    trials = 4000
    copies = np.array([resampling.systematic(weight, group, count, rng) for _ in range(trials)])
    mass = np.bincount(group, weight, len(count))
    expected = weight * count[group] / mass[group]
    # A number of copies takes two neighbouring values, so its variance is f (1 - f).
    fraction = expected % 1.0
    error = 4.5 * np.sqrt(fraction * (1.0 - fraction) / trials) + 1e-12
    assert (np.abs(copies.mean(axis=0) - expected) <= error).all()


def test_nothing_is_drawn_of_nothing():
    weight = np.array([1.0, 0.0, 2.0, 0.0])
    group = np.array([0, 0, 1, 1])
    rng = np.random.default_rng(1)
    for _ in range(200):
        copies = resampling.systematic(weight, group, np.array([3, 7]), rng)
        np.testing.assert_array_equal(copies, [3, 0, 7, 0])
    none = np.zeros(0)
    copies = resampling.systematic(
        none, none.astype(int), np.zeros(0, dtype=int), np.random.default_rng(0)
    )
    assert copies.shape == (0,)
    count, _ = resampling.allocate(np.array([0.0, 1.0]), 100, 20, np.random.default_rng(0))
    np.testing.assert_array_equal(count, [0, 100])


@pytest.mark.parametrize("offset", [0.0, 0.5, np.nextafter(1.0, 0.0)])
@pytest.mark.parametrize("size", [3, 7, 10, 49])
def test_comb_loses_no_copy_by_rounding(offset, size):
    # Sums of tenths and sevenths are rounded; the last tooth must be counted all the same.
    weight = np.tile(np.full(size, 1.0 / size), 3)
    group = np.repeat([0, 1, 2], size)
    copies = resampling.comb(weight, group, np.array([size, 1, 20]), np.full(3, offset))
    np.testing.assert_array_equal(np.bincount(group, copies), [size, 1, 20])
    assert (copies >= 0).all()


@settings(deadline=None, max_examples=100)
@given(
    mass=st.lists(st.floats(1e-7, 5.0), min_size=1, max_size=10).map(np.array),
    per_target=st.integers(10, 500),
    least=st.integers(1, 50),
)
def test_allocate_keeps_the_mass_of_every_group_with_a_particle_of_its_own(mass, per_target, least):
    count, weight = resampling.allocate(mass, per_target, least, np.random.default_rng(0))
    sure = mass * per_target >= 1.0
    np.testing.assert_allclose((count * weight)[sure], mass[sure], rtol=1e-12)
    assert (count[sure] >= least).all()
    np.testing.assert_array_less(count[sure], np.maximum(mass[sure] * per_target, least) + 1.0)


def test_within_leaves_alone_what_fits():
    mass = np.array([1.0, 0.2, 1e-3])
    assert resampling.fit_to_budget(1500, mass, 1000, 100) == (1000, 100)


def test_within_takes_first_from_those_without_mass():
    # Two targets, and a thousand groups of small mass.
    mass = np.concatenate([[1.0, 1.0], np.full(1000, 0.01)])
    density, least = resampling.fit_to_budget(20_000, mass, 1000, 200)
    assert density == 1000
    count, weight = resampling.allocate(mass, density, least, np.random.default_rng(0))
    assert count[:2].tolist() == [1000, 1000]
    assert 10_000 < count.sum() <= 20_000
    np.testing.assert_allclose(count * weight, mass, rtol=1e-12)


def test_within_holds_for_more_mass_than_it_has_particles_for():
    mass = np.random.default_rng(0).uniform(0.0, 2.0, 3000)
    density, least = resampling.fit_to_budget(2000, mass, 1000, 200)
    assert least == 1
    totals = []
    for seed in range(50):
        count, weight = resampling.allocate(mass, density, least, np.random.default_rng(seed))
        totals.append((count.sum(), count @ weight))
    counts, masses = np.array(totals).T
    assert counts.mean() <= 2000 * 1.1
    assert masses.mean() == pytest.approx(mass.sum(), rel=0.02)


def test_allocate_keeps_the_mass_of_smaller_groups_in_expectation():
    mass, trials = np.array([1e-4, 3e-3, 9e-3]), 40_000
    rng = np.random.default_rng(2)
    count, weight = resampling.allocate(np.tile(mass, trials), 100, 20, rng)
    assert count.max() <= 1
    kept = (count * weight).reshape(trials, 3)
    chance = mass * 100
    # One particle of weight 1/100 with that probability.
    error = 4.5 * np.sqrt(chance * (1.0 - chance) / trials) / 100
    assert (np.abs(kept.mean(axis=0) - mass) < error).all()


def test_young_origins_have_more_particles():
    count, index = 400, 30
    ages = np.repeat([resampling.YOUNG_SCANS, resampling.YOUNG_SCANS - 1, 0], count)
    row_label = (index - ages) * LABELS_PER_SCAN
    weight = np.full(3 * count, 1.0 / count)
    phd = intensity(np.zeros((3 * count, 5)), weight, row_label=row_label)
    budget = ParticleBudget(per_target=1000, least=20, per_birth_term=64, most=10**6)
    for scan, factor in ((index, resampling.YOUNG_FACTOR), (None, 1.0)):
        kept = resampling.resample(phd, small().model.modes, budget, np.random.default_rng(0), scan)
        copies = [kept.multiplicity[kept.row_label == one].sum() for one in np.unique(row_label)]
        assert copies == [1000, factor * 1000, factor * 1000]
        np.testing.assert_allclose(kept.weight.sum(), 3.0)


@pytest.mark.parametrize("dt", [6.0, 2.0, 9.5])
def test_predict_mass_is_that_of_survivors_spawned_and_born(dt):
    phd = scattered()
    predicted = predict(phd, MODEL, *METHOD, dt, 3, np.random.default_rng(0))
    share = dt / 6.0
    births = share * sum(term.rate.sum() for term in MODEL.births)
    expected = 0.99**share * 2.0 + 0.01 * share * 2.0 + births
    assert predicted.weight.sum() == pytest.approx(expected, rel=1e-12)
    born = predicted.parent < 0
    assert predicted.weight[born].sum() == pytest.approx(births, rel=1e-12)


def test_predict_uses_each_class_survival():
    classes = tuple(
        replace(model, survival_probability=p)
        for model, p in zip(MODES.classes, (0.9, 0.5), strict=True)
    )
    model = replace(
        MODEL,
        modes=replace(MODES, classes=classes),
        births=(),
        spawn=replace(MODEL.spawn, rate=0.0),
    )
    phd = scattered()
    before = phd.class_mass(MODES.class_of, 2)
    predicted = predict(phd, model, *METHOD, 6.0, 1, np.random.default_rng(0))
    after = predicted.class_mass(MODES.class_of, 2)
    np.testing.assert_allclose(after, before * [0.9, 0.5], rtol=1e-12)


def test_predict_moves_every_copy_with_noise_of_its_own():
    state = np.repeat([[0.0, 10.0, 0.0, 5.0, 0.0]], 2, axis=0)
    phd = intensity(state, [0.6, 0.2], multiplicity=np.array([3, 1]))
    model = replace(MODEL, births=(), spawn=replace(MODEL.spawn, rate=0.0))
    predicted = predict(phd, model, *METHOD, 6.0, 1, np.random.default_rng(0))
    assert len(predicted) == 4
    assert len(np.unique(predicted.state[:, 0])) == 4
    np.testing.assert_array_equal(predicted.parent, [0, 0, 0, 1])
    np.testing.assert_array_equal(predicted.multiplicity, 1)
    np.testing.assert_allclose(predicted.weight, np.full(4, 0.2 * 0.99))


def test_predict_survivors_keep_class_origin_and_poisson_weight():
    phd = scattered()
    model = replace(MODEL, births=(), spawn=replace(MODEL.spawn, rate=0.0))
    predicted = predict(phd, model, *METHOD, 6.0, 1, np.random.default_rng(0))
    source = phd.mode[predicted.parent]
    np.testing.assert_array_equal(MODES.class_of[predicted.mode], MODES.class_of[source])
    np.testing.assert_array_equal(predicted.row_label, phd.row_label[predicted.parent])
    assert (predicted.mode != source).any()
    held = sparse.csr_array((phd.weight, (np.arange(len(phd)), phd.row_label)), shape=(len(phd), 3))
    updated = replace(
        phd, poisson=np.zeros(len(phd)), components=held, label=np.arange(3, dtype=np.int64)
    )
    predicted = predict(updated, MODEL, *METHOD, 6.0, 1, np.random.default_rng(0))
    assert predicted.components.shape == (len(predicted), 0)
    np.testing.assert_array_equal(predicted.weight, predicted.poisson)


def test_predict_draws_modes_by_the_transition_over_the_interval():
    count = 20_000
    phd = intensity(np.zeros((count, 5)), np.full(count, 1e-4), mode=np.full(count, 2))
    model = replace(MODEL, births=(), spawn=replace(MODEL.spawn, rate=0.0))
    predicted = predict(phd, model, *METHOD, 3.0, 1, np.random.default_rng(0))
    share = np.bincount(predicted.mode, minlength=4) / count
    expected = MODES.transition(3.0)[2]
    error = 4.5 * np.sqrt(expected * (1.0 - expected) / count)
    assert (np.abs(share - expected) <= error).all()


def test_predict_names_births_after_term_and_scan_if_there_are_some():
    empty = ParticleSet.empty(5)
    rng = np.random.default_rng(0)
    scans = [predict(empty, MODEL, *METHOD, 6.0, index, rng) for index in (0, 1)]
    names = [set(scan.row_label.tolist()) for scan in scans]
    assert names == [{0, 1, 2, 3}, {LABELS_PER_SCAN + term for term in range(4)}]
    for term, (mean, _) in enumerate(zip(MODEL.births, range(4), strict=True)):
        near = scans[0].state[scans[0].row_label == term]
        assert np.abs(near[:, 0] - mean.mean[0]).max() < 6.0 * 200.0
    model = replace(MODEL, births=())
    predicted = predict(empty, model, *METHOD, 6.0, 0, np.random.default_rng(0))
    assert len(predicted) == 0
