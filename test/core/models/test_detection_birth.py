from dataclasses import replace

import numpy as np
import pytest
from runs import ENGINES
from scenes import small
from scipy.stats import norm

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.models import detection_birth, newborn_sampling
from phd_jdtc_ros.core.models.detection_birth import DetectionBirthModel, Newborn
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.smc.correction import BERNOULLI, CORRECTORS
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.smc.update import ParticleSteps
from phd_jdtc_ros.core.types import Coverage, Detections, Scan
from phd_jdtc_ros.core.window.update import update, update_scan
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

MODEL = small().model
MODES, RADAR = MODEL.modes, MODEL.radars[1]
BIRTHS = DetectionBirthModel(np.array([0.05, 0.05]), 40.0, 1e-3, 4096)
BORN = replace(MODEL, detection_births=BIRTHS)
EMPTY = ParticleSet.empty(5)


def steps_of(model, corrector=BERNOULLI):
    return ParticleSteps(model, corrector, np.random.default_rng(0))


def unknown():
    """Return a model whose targets appear anywhere and nowhere else."""
    return small({"births": [], "detection_births.rates": [0.05, 0.05]}).model


def one_detection(mass=(0.3, 0.6), place=(6000.0, 0.5)):
    return Newborn(Report(RADAR, Detections(np.array([place]), None)), np.array([mass]))


def test_newborn_mass_follows_the_interval_and_is_carried_by_samples():
    _, mode, weight, _ = newborn_sampling.sample(
        one_detection(), BORN, BIRTHS.particles, np.random.default_rng(0)
    )
    by_class = np.bincount(MODES.class_of[mode], weights=weight)
    np.testing.assert_allclose(by_class, [0.3, 0.6], rtol=2e-3)
    report = Detections(np.array([[6000.0, 0.5]]), np.array([4.5]))
    masses = [
        update(EMPTY, Report(RADAR, report), steps_of(unknown()), dt).newborns[0].mass.sum()
        for dt in (3.0, 6.0)
    ]
    assert masses[1] == pytest.approx(2.0 * masses[0], rel=0.02)


def test_affordable_gives_fewer_particles_first_and_then_leaves_out_the_least_mass():
    model = replace(BIRTHS, particles=64, most=640)
    mass = np.stack([np.linspace(0.01, 0.5, 100), np.zeros(100)], axis=1)
    every = Newborn(Report(RADAR, Detections(np.ones((100, 2)), np.arange(100.0))), mass)
    few, count = detection_birth.limit_newborns(every.take(np.arange(10)), model)
    assert (len(few), count) == (10, 64)
    some, count = detection_birth.limit_newborns(every.take(np.arange(25)), model)
    assert (len(some), count) == (25, 16)
    kept, count = detection_birth.limit_newborns(every, model)
    assert (len(kept), count) == (40, 16)
    np.testing.assert_array_equal(kept.mass, mass[60:])
    np.testing.assert_array_equal(kept.report.detections.amplitude, np.arange(60.0, 100.0))


def test_intensity_is_the_same_in_chunks(monkeypatch):
    report = Detections(np.array([[6e3, 0.5], [6.2e3, 0.52]]), None)
    found = Newborn(Report(RADAR, report), np.array([[0.3, 0.6], [0.1, 0.2]]))
    rng = np.random.default_rng(0)
    state, mode, _, _ = newborn_sampling.sample(found, BORN, 64, rng)
    whole = newborn_sampling.intensity(found, BORN, state, mode)
    monkeypatch.setattr(newborn_sampling, "CHUNK_PRODUCT", 14)
    np.testing.assert_array_equal(newborn_sampling.intensity(found, BORN, state, mode), whole)


def test_sample_is_about_the_detection():
    state, mode, _, detection = newborn_sampling.sample(
        one_detection(), BORN, BIRTHS.particles, np.random.default_rng(0)
    )
    measured = RADAR.measure(state)
    assert (detection == 0).all()
    assert measured.mean(axis=0) == pytest.approx([6000.0, 0.5], abs=5.0)
    np.testing.assert_allclose(measured.std(axis=0), RADAR.noise_std, rtol=0.02)
    np.testing.assert_allclose(state[:, [1, 3]].std(axis=0), 40.0, rtol=0.02)
    turning = np.isin(mode, [1, 3])
    assert (state[~turning, 4] == 0.0).all()
    assert state[turning, 4].std() == pytest.approx(1e-3, rel=0.05)


def test_intensity_equals_the_density_written_out():
    report = Detections(np.array([[6000.0, 0.5], [9000.0, np.pi]]), None)
    found = Newborn(Report(RADAR, report), np.array([[0.3, 0.6], [0.2, 0.1]]))
    state, mode, _, _ = newborn_sampling.sample(
        found, BORN, BIRTHS.particles, np.random.default_rng(1)
    )
    chosen = np.arange(0, len(state), 97)
    state, mode = state[chosen], mode[chosen]
    measured = RADAR.measure(state)
    expected = np.zeros(len(state))
    for (distance, azimuth), mass in zip(report.measurement, found.mass, strict=True):
        turn = np.angle(np.exp(1j * (measured[:, 1] - azimuth)))
        density = norm.pdf(measured[:, 0], distance, RADAR.range_std)
        density *= norm.pdf(turn, 0.0, RADAR.azimuth_std) / measured[:, 0]
        density *= norm.pdf(state[:, 1], 0.0, 40.0) * norm.pdf(state[:, 3], 0.0, 40.0)
        density *= np.where(np.isin(mode, [1, 3]), norm.pdf(state[:, 4], 0.0, 1e-3), 1.0)
        expected += density * mass[MODES.class_of[mode]] / 2.0
    found_intensity = newborn_sampling.intensity(found, BORN, state, mode)
    np.testing.assert_allclose(found_intensity, expected, rtol=1e-6)


def test_update_leaves_unclaimed_detections_as_newborn_if_there_are_such_births():
    # 45 dB: no clutter is that strong; 4: any clutter is.
    report = Detections(np.array([[6000.0, 0.5], [9000.0, 2.0]]), np.array([200.0, 4.0]))
    (found,) = update(EMPTY, Report(RADAR, report), steps_of(unknown()), 6.0).newborns
    assert found.mass[0].sum() == pytest.approx(1.0, abs=1e-6)
    assert found.mass[0, 0] > 0.99  # of the stronger class
    assert found.mass[1:].sum() < 0.05
    report = Detections(np.array([[6000.0, 0.5]]), np.array([200.0]))
    assert update(EMPTY, Report(RADAR, report), steps_of(MODEL), 6.0).newborns == ()


def reports_of_one_target(amplitude=200.0):
    """Return both radars' reports of a target, and a model of them without birth places."""
    model = unknown()
    state = np.array([[5e3, 0.0, 4e3, 0.0, 0.0]])
    reports = [Detections(r.measure(state), np.array([amplitude])) for r in model.radars]
    return model, Scan(1, tuple(reports))


@pytest.mark.parametrize("corrector", ["bernoulli", "poisson"])
def test_update_scan_finds_a_target_of_two_radars_once(corrector):
    model, scan = reports_of_one_target()
    updated = update_scan(EMPTY, scan, steps_of(model, CORRECTORS[corrector]), 6.0, 0)
    phd, found = updated.rows, updated.newborns
    assert [one.mass.sum() for one in found] == pytest.approx([1.0, 0.0], abs=0.05)
    assert phd.weight.sum() == pytest.approx(1.0, abs=0.05)


def test_update_scan_gives_every_detection_an_origin_of_its_own():
    model, scan = reports_of_one_target()
    far = Detections(np.array([[6000.0, 0.5], [9000.0, 2.0]]), np.array([200.0, 200.0]))
    scan = replace(scan, detections=(far, scan.detections[1]))
    scans = [update_scan(EMPTY, scan, steps_of(model), 6.0, k).rows for k in (2, 3)]
    assert [len(set(phd.row_label)) for phd in scans] == [3, 3]
    assert not set(scans[0].row_label) & set(scans[1].row_label)
    for phd in scans:
        assert (phd.parent == -1).all()
        assert set(phd.label) == set(phd.row_label)


def test_tracker_finds_targets_without_known_birth_places():
    config = resolve(
        {"births": [], "detection_births.rates": [0.05, 0.05], "particles_per_target": 500}
    )
    engine = new_engine(config)
    run = simulate(paper_scenario(config.model.radars), 5)[:15]
    for _, scan in run:
        step = engine.step(scan)
    truth = run[-1][0]
    (found,) = step.filtered
    offset = found.position[:, None] - truth.position[None]
    distance = np.hypot(*offset.transpose(2, 0, 1))
    assert len(step.filtered[0]) == 3
    assert distance.min(axis=0).max() < 600.0


HIDDEN = {"min_range": 3e4, "max_range": 5e4}


def odds_of_birth(engine, first, given=None):
    """Return the odds that the second radar's only detection is a new target.

    `first` is the first radar's report.
    """
    config = small(
        {
            "engine": engine,
            "amplitude": "none",
            "births": [],
            "detection_births.rates": [0.05, 0.05],
            "radar_1.detection_probability": 0.7,
            "radar_2.detection_probability": 0.6,
            **(given or {}),
        }
    )
    second = Detections(np.array([[6e3, 0.5]]), None)
    step = new_engine(config).step(Scan(1, (first, second)))
    mass = step.class_mass.sum()
    return mass / (1.0 - mass)


@pytest.mark.parametrize("engine", ENGINES)
def test_unknown_targets_that_an_earlier_radar_would_have_seen_are_the_fewer(engine):
    nothing = Detections(np.zeros((0, 2)), None)
    alone = odds_of_birth(engine, None)
    assert 0.001 < alone < 1.0
    assert odds_of_birth(engine, nothing) == pytest.approx(0.3 * alone, rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("first", "given"),
    [
        (Detections(np.zeros((0, 2)), None), {f"radar_1.{k}": v for k, v in HIDDEN.items()}),
        (Detections(np.zeros((0, 2)), None, coverage=Coverage(2.0, 1.0)), {}),
    ],
    ids=["out of range", "in another sector"],
)
def test_unknown_targets_that_no_earlier_radar_could_see_are_as_many(engine, first, given):
    hidden = odds_of_birth(engine, first, given)
    assert hidden == pytest.approx(odds_of_birth(engine, None, given), rel=1e-9)


def test_missed_by_is_the_product_of_the_radars_that_looked_of_what_they_took_in():
    model = small({"radar_1.detection_probability": 0.7}).model
    place = np.array([[6e3, 0.0], [0.0, 5e3]])
    nothing, none = Detections(np.zeros((0, 2)), None), np.zeros((0, 2))
    ahead = replace(nothing, coverage=Coverage(-1.0, 2.0))
    first = Newborn(Report(model.radars[0], nothing, share=0.5), none)
    second = Newborn(Report(model.radars[1], ahead), none)
    p_d = model.radars[1].class_detection_probability(MODES.classes)
    missed = detection_birth.missed_by((first.report, second.report), place, MODES)
    np.testing.assert_allclose(missed[:, 0], 0.65 * (1.0 - p_d), rtol=1e-12)
    np.testing.assert_allclose(missed[:, 1], 0.65, rtol=1e-12)
    np.testing.assert_array_equal(detection_birth.missed_by((), place, MODES), 1.0)
