import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from paper_room import particles, scattered, small

from phd_jdtc_ros.core.phd import resampling
from phd_jdtc_ros.core.phd.resampling import ParticleBudget

MODES = small().model.modes


def budget(most, per_target, least):
    return ParticleBudget(per_target, least, per_birth_term=64, most=most)


USUAL = budget(200_000, 200, 20)


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
    group = np.repeat([0, 1, 3], [7, 1, 12])  # Group 2 is empty
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


def test_within_holds_for_more_mass_than_it_has_particles_for():
    mass = np.random.default_rng(0).uniform(0.0, 2.0, 3000)
    density, least = resampling.fit_to_budget(mass, budget(2000, 1000, 200))
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


def updated_set():
    """Return a set whose weight is in two components and outside of them, by turns."""
    phd = scattered()
    share = np.random.default_rng(1).dirichlet(np.ones(3), len(phd)) * phd.weight[:, None]
    return particles(
        phd.state, share[:, 2], mode=phd.mode, origin=phd.origin, components=share[:, :2]
    )


def component_mass(phd):
    return phd.components.toarray().sum(axis=0)


def group_mass(phd):
    mass = {}
    for c, o, w in zip(MODES.class_of[phd.mode], phd.origin, phd.weight, strict=True):
        mass[int(c), int(o)] = mass.get((int(c), int(o)), 0.0) + w
    return mass


def test_resample_keeps_the_mass_of_every_class_and_origin():
    phd = updated_set()
    before = group_mass(phd)
    # Enough particles that no group is too small for one.
    many = budget(10**6, 100_000, 20)
    after = group_mass(resampling.resample(phd, MODES, many, np.random.default_rng(0)))
    assert len(before) == 6
    assert min(before.values()) > 1e-5
    for key, mass in before.items():
        assert after[key] == pytest.approx(mass, rel=1e-9)


def test_resample_scales_every_component_by_the_new_over_the_old_weight():
    phd = updated_set()
    kept = resampling.resample(phd, MODES, USUAL, np.random.default_rng(0))
    by_state = {row.tobytes(): index for index, row in enumerate(phd.state)}
    source = np.array([by_state[row.tobytes()] for row in kept.state])
    factor = kept.weight / phd.weight[source]
    assert np.ptp(factor) > 0.1
    np.testing.assert_allclose(kept.poisson, phd.poisson[source] * factor, rtol=1e-10)
    expected = phd.components.toarray()[source] * factor[:, None]
    np.testing.assert_allclose(kept.components.toarray(), expected, rtol=1e-10)
    for name in ("mode", "origin", "parent"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(phd, name)[source])


def test_resample_gives_sorted_unique_rows_of_equally_heavy_copies():
    kept = resampling.resample(updated_set(), MODES, USUAL, np.random.default_rng(0))
    assert len(np.unique(kept.state, axis=0)) == len(kept)
    assert kept.multiplicity.max() > 1
    group = np.stack([MODES.class_of[kept.mode], kept.origin], axis=1)
    assert (np.diff(group @ [100, 1]) >= 0).all()
    per_copy = kept.weight / kept.multiplicity
    for key in np.unique(group, axis=0):
        chosen = (group == key).all(axis=1)
        np.testing.assert_allclose(per_copy[chosen], per_copy[chosen][0], rtol=1e-9)


def test_resample_is_unbiased_in_every_component():
    phd = updated_set()
    rng = np.random.default_rng(1)
    many = budget(10**6, 30, 1)
    before = component_mass(phd)
    trials = np.array(
        [component_mass(resampling.resample(phd, MODES, many, rng)) for _ in range(400)]
    )
    error = 4.5 * trials.std(axis=0) / np.sqrt(len(trials)) + 1e-12
    assert (np.abs(trials.mean(axis=0) - before) <= error).all()
