"""The amount of computation and memory, counted and not timed."""

import tracemalloc

import numpy as np
import pytest
from scenes import gaussian_cloud, intensity, small

from phd_jdtc_ros.core.pair_search import candidates, grid, sweep
from phd_jdtc_ros.core.pair_search.gating import cell_lists, count_near
from phd_jdtc_ros.core.smc.correction import CORRECTORS
from phd_jdtc_ros.core.smc.kernel import backward_kernel, transition_density
from phd_jdtc_ros.core.targets.motion import sample

SPACING = 2500.0


def tracked(targets, per_target, corrector="poisson", spacing=SPACING):
    """Return the arguments of a build: two stored sets of well-tracked targets, 6 s apart.

    With the PHD filter's corrector spawned targets are in mu, and no row_label keeps rows apart.
    """
    model = small().model
    rng = np.random.default_rng(targets)
    mode = np.repeat(np.arange(targets) % 4, per_target)
    # The targets are in a square, so that a search over one coordinate would find rows of other
    # targets.
    side = int(np.ceil(np.sqrt(targets)))
    place = np.repeat(np.arange(targets), per_target)
    centre = np.zeros((len(place), 5))
    centre[:, 0], centre[:, 2] = spacing * (place // side), spacing * (place % side)
    centre[:, 1] = 40.0
    state = gaussian_cloud(rng, len(place), centre, [100.0, 7.0, 100.0, 7.0, 1e-2])
    state[mode % 2 == 0, 4] = 0.0
    weight = np.full(len(place), 1.0 / per_target)
    earlier = intensity(state, weight, mode=mode, row_label=place)
    moved = np.empty_like(state)
    for index, motion in enumerate(model.modes.motions):
        moved[mode == index] = sample(motion, state[mode == index], 6.0, rng)
    later = intensity(moved, weight, mode=mode, row_label=place)
    return earlier, later, model, CORRECTORS[corrector], 6.0


def candidates_of_a_build(monkeypatch, *scene):
    """Return candidates tested per later row by every search, and the kernel's pairs."""
    case = tracked(*scene)
    tested = []

    def counted(search):
        def count(*arguments):
            found = search(*arguments)
            tested.append(found.count.sum())
            return found

        return count

    with monkeypatch.context() as patch:
        patch.setattr(transition_density, "candidates", counted(sweep.candidates))
        patch.setattr(transition_density, "grid_candidates", counted(grid.grid_candidates))
        link = backward_kernel.build(*case)
    rows = len(case[1])
    return np.array(tested) / rows, link.ratio.nnz / rows


def test_build_tests_as_many_candidates_a_row_whatever_the_number_of_targets(monkeypatch):
    few, _ = candidates_of_a_build(monkeypatch, 64, 150)
    many, _ = candidates_of_a_build(monkeypatch, 256, 150)
    survival, spawn = many / few
    assert survival <= 1.05
    # The axes that serve best change on the way; other targets in one strip would double it.
    assert spawn <= 1.5


def test_build_tests_few_candidates_for_a_pair(monkeypatch):
    (survival, spawn), pairs = candidates_of_a_build(monkeypatch, 8, 300)
    assert pairs > 3.0
    assert survival <= 4.0 * pairs
    assert spawn <= 30.0 * pairs


def test_build_within_origins_tests_no_strangers(monkeypatch):
    # All targets in one place: without origins every row would be paired with those of all targets.
    (one,), pairs = candidates_of_a_build(monkeypatch, 4, 150, "bernoulli", 0.0)
    (many,), _ = candidates_of_a_build(monkeypatch, 64, 150, "bernoulli", 0.0)
    assert one <= 4.0 * pairs
    assert many <= 1.1 * one


def peak_bytes(call):
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("corrector", ["poisson", "bernoulli"])
@pytest.mark.parametrize("targets", [8, 32])
def test_build_peak_memory_is_some_columns_a_row(targets, corrector):
    case = tracked(targets, 150, corrector)
    peak = peak_bytes(lambda: backward_kernel.build(*case))
    # A dense kernel has 8 bytes for every pair of rows: 10 and 38 kB per row here.
    # Chunks of candidates are a constant part.
    assert peak <= 1100 * len(case[1]) + 80 * candidates.CHUNK_PAIRS


@pytest.mark.parametrize("reports", [10, 300])
def test_gating_lists_little_more_than_it_keeps(reports):
    # Against both gates, 3.6 km of 15 km and 12 of 360 degrees, at every particle.
    rng = np.random.default_rng(0)
    area = np.array([15e3, 2.0 * np.pi])
    measured = rng.uniform(0.0, 1.0, (reports, 2)) * area - [0.0, np.pi]
    particles = rng.uniform(0.0, 1.0, (20_000, 2)) * area - [0.0, np.pi]
    lists = cell_lists(measured, 1800.0, np.radians(6.0))
    compared = np.diff(lists.start)[lists.cells.of(particles)]
    assert count_near(measured, 1800.0, np.radians(6.0), particles) == compared.sum()
    kept = reports * (3600.0 / area[0]) * (np.radians(12.0) / area[1])
    assert compared.mean() <= 2.0 * kept


def test_gating_lists_stay_small_for_gates_of_nothing():
    lists = cell_lists(np.array([[15e3, 0.1], [1.0, 3.0]]), 1e-3, 1e-9)
    assert len(lists.start) < 20_000
    assert len(lists.detection) <= 8
