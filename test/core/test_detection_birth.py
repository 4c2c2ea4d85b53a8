import numpy as np
import pytest
from scenes import small
from scipy.stats import norm

from phd_jdtc_ros.core import detection_birth
from phd_jdtc_ros.core.config import resolve
from phd_jdtc_ros.core.detection_birth import DetectionBirthModel, Newborn
from phd_jdtc_ros.core.filter import ORIGINS_PER_SCAN, predict, update
from phd_jdtc_ros.core.simulation import paper_scenario, simulate
from phd_jdtc_ros.core.types import Detections, ParticlePHD

MODEL = small().model
MODES, RADAR = MODEL.modes, MODEL.radars[1]
BIRTHS = DetectionBirthModel(np.array([0.05, 0.05]), 40.0, 1e-3, 4096)
EMPTY = ParticlePHD.empty(5)


def unknown():
    """Return a model whose targets appear anywhere and nowhere else."""
    return small({"births": [], "detection_births.rates": [0.05, 0.05]}).model


def one_detection(mass=(0.3, 0.6), place=(6000.0, 0.5)):
    return Newborn(RADAR, np.array([place]), np.array([mass]))


def test_sample_carries_the_newborn_mass_and_survival():
    _, mode, weight, _ = detection_birth.sample(
        one_detection(), BIRTHS, MODES, 6.0, np.random.default_rng(0)
    )
    by_class = np.bincount(MODES.class_of[mode], weights=weight)

    np.testing.assert_allclose(by_class, 0.99 * np.array([0.3, 0.6]), rtol=2e-3)


def test_sample_is_about_the_detection_moved_on():
    state, mode, _, detection = detection_birth.sample(
        one_detection(), BIRTHS, MODES, 6.0, np.random.default_rng(0)
    )
    back = state.copy()
    back[:, [0, 2]] -= 6.0 * state[:, [1, 3]]
    measured = RADAR.measure(back)

    assert (detection == 0).all()
    assert measured.mean(axis=0) == pytest.approx([6000.0, 0.5], abs=5.0)
    np.testing.assert_allclose(measured.std(axis=0), RADAR.noise_std, rtol=0.02)
    np.testing.assert_allclose(state[:, [1, 3]].std(axis=0), 40.0, rtol=0.02)
    turning = np.isin(mode, [1, 3])
    assert (state[~turning, 4] == 0.0).all()
    assert state[turning, 4].std() == pytest.approx(1e-3, rel=0.05)


def test_intensity_equals_the_density_written_out():
    found = Newborn(
        RADAR, np.array([[6000.0, 0.5], [9000.0, np.pi]]), np.array([[0.3, 0.6], [0.2, 0.1]])
    )
    state, mode, _, _ = detection_birth.sample(found, BIRTHS, MODES, 4.0, np.random.default_rng(1))
    chosen = np.arange(0, len(state), 97)
    state, mode = state[chosen], mode[chosen]
    back = state.copy()
    back[:, [0, 2]] -= 4.0 * state[:, [1, 3]]
    measured = RADAR.measure(back)
    expected = np.zeros(len(state))
    for (distance, azimuth), mass in zip(found.measurement, found.mass, strict=True):
        turn = np.angle(np.exp(1j * (measured[:, 1] - azimuth)))
        density = norm.pdf(measured[:, 0], distance, RADAR.range_std)
        density *= norm.pdf(turn, 0.0, RADAR.azimuth_std) / measured[:, 0]
        density *= norm.pdf(state[:, 1], 0.0, 40.0) * norm.pdf(state[:, 3], 0.0, 40.0)
        density *= np.where(np.isin(mode, [1, 3]), norm.pdf(state[:, 4], 0.0, 1e-3), 1.0)
        survival = MODES.survival(4.0)[mode]
        expected += density * mass[MODES.class_of[mode]] / 2.0 * survival
    found_intensity = detection_birth.intensity(found, BIRTHS, MODES, 4.0, state, mode)

    np.testing.assert_allclose(found_intensity, expected, rtol=1e-6)


def test_update_leaves_strong_detections_that_nobody_explains_as_newborn():
    # 45 dB: no clutter is that strong; 4: any clutter is.
    report = Detections(np.array([[6000.0, 0.5], [9000.0, 2.0]]), np.array([200.0, 4.0]))
    _, found = update(EMPTY, report, RADAR, unknown(), 6.0)

    assert found.mass[0].sum() == pytest.approx(1.0, abs=1e-6)
    assert found.mass[0, 0] > 0.99  # of the stronger class
    assert found.mass[1:].sum() < 0.05


def test_update_leaves_what_targets_explain_to_the_targets():
    model = unknown()
    report = Detections(np.array([[6000.0, 0.5]]), np.array([200.0]))
    _, found = update(EMPTY, report, RADAR, model, 6.0)
    budget = small().budget
    target = predict(EMPTY, model, budget, 6.0, 1, np.random.default_rng(0), (found,))
    _, again = update(target, report, RADAR, model, 6.0)

    assert again.mass.sum() < 0.05


def test_newborn_mass_follows_the_interval():
    report = Detections(np.array([[6000.0, 0.5]]), np.array([4.5]))
    masses = [update(EMPTY, report, RADAR, unknown(), dt)[1].mass.sum() for dt in (3.0, 6.0)]

    assert masses[1] == pytest.approx(2.0 * masses[0], rel=0.02)


def test_update_without_such_births_leaves_nothing():
    report = Detections(np.array([[6000.0, 0.5]]), np.array([200.0]))

    assert update(EMPTY, report, RADAR, MODEL, 6.0)[1] is None


def test_predict_gives_every_detection_an_origin_of_its_own():
    found = Newborn(RADAR, np.array([[6000.0, 0.5], [9000.0, 2.0]]), np.full((2, 2), 0.2))
    budget = small().budget
    phd = predict(EMPTY, unknown(), budget, 6.0, 3, np.random.default_rng(0), (found, found))

    assert set(phd.origin) == {3 * ORIGINS_PER_SCAN + row for row in range(4)}
    assert (phd.parent == -1).all()


def test_tracker_finds_targets_without_known_birth_places():
    config = resolve(
        {
            "births": [],
            "detection_births.rates": [0.05, 0.05],
            "particles_per_target": 500,
        }
    )
    engine = config.engine()
    run = simulate(paper_scenario(config.model.radars), 5)[:15]
    for _, scan in run:
        step = engine.step(scan)
    truth = run[-1][0]
    distance = np.hypot(
        *(step.filtered.state[:, None, [0, 2]] - truth.state[None][:, :, [0, 2]]).transpose(2, 0, 1)
    )

    assert len(step.filtered) == 3
    assert distance.min(axis=0).max() < 600.0
