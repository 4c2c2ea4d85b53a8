"""Clutter that is higher than noise."""

from dataclasses import replace

import numpy as np
import pytest
from runs import learned, stored_and_read
from scenes import small
from sweep import configuration

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors import ClutterMap, Learned
from phd_jdtc_ros.core.factors.clutter.amplitude import CELLS, MEMORY
from phd_jdtc_ros.core.types import FULL_TURN, Coverage, Detections, Scan
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.simulation.clutter import NOISE, UniformClutter
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

# Targets are born at detections; three false detections a scan and radar.
ANYWHERE = {
    "births": [],
    "detection_births.rates": [0.05, 0.05],
    "radar_1.clutter_rate": 3.0,
    "radar_2.clutter_rate": 3.0,
    "lag": 2,
}
NAME = "clutter"
LEARNED = {"radar_1.clutter_amplitude": "learned", "radar_2.clutter_amplitude": "learned"}
RADARS = small(ANYWHERE).model.radars
LOUD = UniformClutter(10.0, 20.0)


def scans(law, count=40, seed=3):
    scene = replace(paper_scenario(RADARS), scans=count, clutter=(law, law))
    return simulate(scene, seed)


def engine_of(**given):
    return new_engine(small({**ANYWHERE, **LEARNED, **given}))


def learned_counts(engine):
    """Return the number of false detections in the learned law of each radar."""
    return {name: law.count.sum() for name, law in learned(engine, Learned).items()}


def errors(engine, run):
    """Return how many estimates are false and how many targets are missed in a run."""
    false = missed = 0
    for truth, scan in run:
        (found,) = engine.step(scan).filtered
        paired, _ = assign(truth.position, found.position, 1000.0, 2.0)
        false += len(found) - len(paired)
        missed += len(truth.state) - len(paired)
    return false, missed


def test_high_clutter_makes_no_false_targets_once_it_is_learned():
    noisy = dict.fromkeys(LEARNED, "rayleigh")
    false, _ = errors(engine_of(**noisy), scans(LOUD))
    assert false > 50
    tracker = engine_of()
    false, missed = errors(tracker, scans(LOUD))
    assert false <= 2
    _, among_noise = errors(engine_of(), scans(NOISE))
    assert missed <= among_noise
    # The learned law is that of the clutter and not of the targets.
    for law in learned(tracker, Learned).values():
        level = np.linspace(-20.0, 80.0, CELLS + 1)[:-1] + 0.25
        inside = (level > 10.0) & (level < 20.0)
        assert law.count[inside].sum() > 60.0
        assert law.count[level > 26.0].sum() < 0.06 * law.count.sum()


def test_one_high_detection_among_noise_is_no_target():
    """Against noise its existence is certain at once."""
    existence = {}
    threshold = RADARS[0].threshold
    for law in ("rayleigh", "learned"):
        reported = {"existence": [1e-9, 1e-9]}
        tracker = engine_of(**reported, **dict.fromkeys(LEARNED, law))
        for index in range(30):
            rng = np.random.default_rng(index)
            place = np.stack([rng.uniform(2e3, 14e3, 3), rng.uniform(-3.0, 3.0, 3)], axis=1)
            found = Detections(place, NOISE.draw(threshold, 3, rng))
            tracker.step(Scan((index + 1) * 6_000_000_000, (found, None)))
        high = Detections(np.array([[8e3, 3.1]]), np.array([14.0]))
        step = tracker.step(Scan(31 * 6_000_000_000, (high, None)))
        existence[law] = step.filtered[0].weight.max(initial=0.0)
    assert existence["rayleigh"] > 0.95
    assert existence["learned"] < 0.5


def stored():
    tracker = engine_of()
    for _, scan in scans(LOUD, 4):
        tracker.step(scan)
    return stored_and_read(tracker.snapshot())


def test_noise_stores_nothing_of_clutter():
    tracker = engine_of(**dict.fromkeys(LEARNED, "rayleigh"))
    for _, scan in scans(NOISE, 4):
        tracker.step(scan)
    assert not [name for name in tracker.snapshot().arrays if name.startswith(NAME)]


def test_more_clutter_than_is_remembered_is_refused():
    held = stored()
    held.arrays[f"{NAME}.radar_1.count"] = np.full(CELLS, 0.5 * MEMORY)
    with pytest.raises(ValueError, match="detections, at most"):
        engine_of().restore(held)


def test_another_threshold_keeps_what_has_been_learned():
    tracker = engine_of()
    run = [scan for _, scan in scans(LOUD, 6)]
    for scan in run[:5]:
        tracker.step(scan)
    before = learned_counts(tracker)
    threshold = {"radar_1.false_alarm_probability": 1e-4}
    other = small({**ANYWHERE, **LEARNED, **threshold})
    tracker.retune(other.model, tracker.rule)
    tracker.step(run[5])
    law = learned(tracker, Learned)["radar_1"]
    assert law.threshold == other.model.radars[0].threshold
    assert law.count.sum() > before["radar_1"]


def test_the_sectors_of_a_revolution_teach_the_radars_law_and_map():
    given = {"radar.clutter_amplitude": "learned", "radar.clutter_map": True, "amplitude": "band"}
    config = configuration(given)
    tracker = new_engine(config)
    rng = np.random.default_rng(4)
    width = FULL_TURN / 16
    for step in range(64):
        azimuth = step % 16 * width + rng.uniform(0.0, width, 2) - np.pi
        place = np.stack([rng.uniform(5e3, 95e3, 2), azimuth], axis=1)
        found = Detections(
            place,
            LOUD.draw(config.model.radars[0].threshold, 2, rng),
            coverage=Coverage(step % 16 * width - np.pi, width),
        )
        tracker.step(Scan((step + 1) * 250_000_000, (found,)))
    law = learned(tracker, Learned)["radar"]
    assert isinstance(law, Learned)
    assert 90.0 < law.count.sum() <= 128.0
    places = learned(tracker, ClutterMap)["radar"]
    assert places.revolutions == pytest.approx(4.0, rel=0.03)
    assert 90.0 < places.count.sum() <= 128.0


def test_without_amplitudes_nothing_is_learned():
    tracker = engine_of(amplitude="none")
    for _, scan in scans(LOUD, 4):
        tracker.step(scan)
    assert learned_counts(tracker) == dict.fromkeys(("radar_1", "radar_2"), 0.0)
