from dataclasses import replace

import numpy as np
import pytest
from paper_room import particles, scattered, small
from scipy import sparse

from phd_jdtc_ros.core.phd.particles import Particles
from phd_jdtc_ros.core.phd.prediction import predict

CONFIG = small()
BUDGET, MODEL = CONFIG.budget, CONFIG.model
MODES = MODEL.modes


def class_mass(phd):
    return np.bincount(MODES.class_of[phd.mode], phd.weight, 2)


@pytest.mark.parametrize("dt", [6.0, 2.0, 9.5])
def test_predict_mass_is_that_of_survivors_spawned_and_born(dt):
    phd = scattered()
    predicted = predict(phd, MODEL, BUDGET, dt, 3, np.random.default_rng(0))
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
    before = class_mass(phd)
    predicted = predict(phd, model, BUDGET, 6.0, 1, np.random.default_rng(0))
    after = class_mass(predicted)
    np.testing.assert_allclose(after, before * [0.9, 0.5], rtol=1e-12)


def test_predict_moves_every_copy_with_noise_of_its_own():
    state = np.repeat([[0.0, 10.0, 0.0, 5.0, 0.0]], 2, axis=0)
    phd = particles(state, [0.6, 0.2], multiplicity=np.array([3, 1]))
    model = replace(MODEL, births=(), spawn=replace(MODEL.spawn, rate=0.0))
    predicted = predict(phd, model, BUDGET, 6.0, 1, np.random.default_rng(0))
    assert len(predicted) == 4
    assert len(np.unique(predicted.state[:, 0])) == 4
    np.testing.assert_array_equal(predicted.parent, [0, 0, 0, 1])
    np.testing.assert_array_equal(predicted.multiplicity, 1)
    np.testing.assert_allclose(predicted.weight, np.full(4, 0.2 * 0.99))


def test_predict_survivors_keep_class_origin_and_poisson_weight():
    phd = scattered()
    model = replace(MODEL, births=(), spawn=replace(MODEL.spawn, rate=0.0))
    predicted = predict(phd, model, BUDGET, 6.0, 1, np.random.default_rng(0))
    source = phd.mode[predicted.parent]
    np.testing.assert_array_equal(MODES.class_of[predicted.mode], MODES.class_of[source])
    np.testing.assert_array_equal(predicted.origin, phd.origin[predicted.parent])
    assert (predicted.mode != source).any()
    explained = phd.explained_by(np.zeros(len(phd)), sparse.csr_array(phd.weight[:, None]))
    predicted = predict(explained, MODEL, BUDGET, 6.0, 1, np.random.default_rng(0))
    assert predicted.components.shape == (len(predicted), 0)
    np.testing.assert_array_equal(predicted.weight, predicted.poisson)


def test_predict_draws_modes_by_the_transition_over_the_interval():
    count = 20_000
    phd = particles(np.zeros((count, 5)), np.full(count, 1e-4), mode=np.full(count, 2))
    model = replace(MODEL, births=(), spawn=replace(MODEL.spawn, rate=0.0))
    predicted = predict(phd, model, BUDGET, 3.0, 1, np.random.default_rng(0))
    share = np.bincount(predicted.mode, minlength=4) / count
    expected = MODES.transition(3.0)[2]
    error = 4.5 * np.sqrt(expected * (1.0 - expected) / count)
    assert (np.abs(share - expected) <= error).all()


def test_predict_names_births_after_term_and_scan_if_there_are_some():
    empty = Particles.empty(5)
    rng = np.random.default_rng(0)
    scans = [predict(empty, MODEL, BUDGET, 6.0, index, rng) for index in (0, 1)]
    names = [set(scan.origin.tolist()) for scan in scans]
    assert names == [{0, 1, 2, 3}, {4, 5, 6, 7}]
    for term, (mean, _) in enumerate(zip(MODEL.births, range(4), strict=True)):
        near = scans[0].state[scans[0].origin == term]
        assert np.abs(near[:, 0] - mean.mean[0]).max() < 6.0 * 200.0
    model = replace(MODEL, births=())
    predicted = predict(empty, model, BUDGET, 6.0, 0, np.random.default_rng(0))
    assert len(predicted) == 0
