"""A clutter rate that is learned from what no target claims."""

from dataclasses import replace

import lone
import numpy as np
import pytest
import runs
from reference import resolve
from scenes import small
from sweep import configuration

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors.clutter.rate import MEMORY_REVOLUTIONS, START_RATE, ClutterRate
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.types import FULL_TURN, Coverage, Detections, Scan
from phd_jdtc_ros.evaluation.metrics import ospa
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

# Five times less and five times more than what the tracker begins with.
RATES = (START_RATE / 5.0, 5.0 * START_RATE)


RADARS = ("radar_1", "radar_2")
LEARNING = {f"{radar}.learn": ["clutter"] for radar in RADARS}


def rates(value):
    """Return the parameters of radars with a given rate, which is not learned."""
    given = {f"{radar}.clutter_rate": value for radar in RADARS}
    return {**given, **{f"{radar}.learn": [] for radar in RADARS}}


def run_of(rate, count, seed=7):
    radars = small(rates(rate)).model.radars
    return list(simulate(replace(paper_scenario(radars), scans=count), seed))


def engine_of(**given):
    return new_engine(small({"lag": 0, **LEARNING, **given}))


def learned(tracker):
    return {name: count.rate for name, count in runs.learned(tracker, ClutterRate).items()}


@pytest.mark.parametrize("amplitude", ["band", "none"])
@pytest.mark.parametrize("rate", RATES)
def test_a_rate_five_times_wrong_is_right_after_fifty_scans(rate, amplitude):
    tracker = engine_of(amplitude=amplitude)
    for _, scan in run_of(rate, 50):
        tracker.step(scan)
    assert learned(tracker) == pytest.approx({"radar_1": rate, "radar_2": rate}, rel=0.2)


def distances(tracker, run):
    found = [
        ospa(truth.position, tracker.step(scan).filtered[0].position, 1000.0, 2.0).distance
        for truth, scan in run
    ]
    return float(np.mean(found[30:]))


@pytest.mark.parametrize("rate", RATES)
def test_learned_rate_tracks_as_well_as_the_right_one(rate):
    run = run_of(rate, 60)
    given = {"amplitude": "none"}
    right = distances(engine_of(**given, **rates(rate)), run)
    assert distances(engine_of(**given), run) == pytest.approx(right, rel=0.03)


def test_a_given_rate_is_not_learned_and_a_learned_one_is_simulated_from_its_start():
    tracker = engine_of(**rates(START_RATE))
    for _, scan in run_of(4.0, 3):
        tracker.step(scan)
    assert learned(tracker) == {}
    assert not [name for name in tracker.snapshot().arrays if name.startswith("clutter")]
    scenario = paper_scenario(resolve({"radar_1.learn": ["clutter"]}).model.radars)
    assert [radar.clutter_rate for radar in scenario.radars] == [START_RATE, START_RATE]


@pytest.mark.parametrize("rate", [0.5, 4.0, START_RATE, 300.0])
def test_learning_begins_with_the_given_rate(rate):
    given = {"radar_1.learn": ["clutter"], "radar_1.clutter_rate": rate}
    count = runs.learned(new_engine(resolve(given)), ClutterRate)["radar_1"]
    assert count.rate == pytest.approx(rate)


def test_count_forgets_and_takes_sectors_for_one_revolution():
    count = ClutterRate()
    for _ in range(200):
        count = count.after(3.0, 1.0)
    assert count.rate == pytest.approx(3.0, rel=0.02)
    assert count.revolutions < 1.02 * MEMORY_REVOLUTIONS
    for _ in range(3):
        count = count.after(0.0, 1.0)
    assert 2.5 < count.rate < 2.9
    whole, sectors = ClutterRate().after(8.0, 1.0), ClutterRate()
    for _ in range(16):
        sectors = sectors.after(0.5, 1.0 / 16.0)
    assert sectors.rate == pytest.approx(whole.rate, rel=0.02)


@pytest.mark.parametrize("clutter_map", [False, True])
def test_the_rate_of_a_radar_that_reports_sectors_is_that_of_a_revolution(clutter_map):
    given = {"radar.learn": ["clutter"], "radar.clutter_map": clutter_map}
    tracker, rng, width = new_engine(configuration(given)), np.random.default_rng(4), FULL_TURN / 16
    for step in range(16 * 6):
        azimuth = step % 16 * width + rng.uniform(0.0, width, 2) - np.pi
        place = np.stack([rng.uniform(5e3, 95e3, 2), azimuth], axis=1)
        found = Detections(place, None, coverage=Coverage(step % 16 * width - np.pi, width))
        tracker.step(Scan((step + 1) * 250_000_000, (found,)))
    assert learned(tracker) == pytest.approx({"radar": 32.0}, rel=0.2)


def rate_of_clutter(config, reports):
    """Return the rate that a radar without targets learns from reports."""
    nothing, factors = Dynamics(config.model).nothing, None
    for found in reports:
        factors = lone.learned(config, nothing, found, factors).factors
    return factors.find("radar", ClutterRate).rate


def test_with_a_map_the_rate_is_that_of_what_comes_from_no_place_in_particular():
    """A quay of thirty reflectors, and six false detections somewhere else."""
    given = {"radar.learn": ["clutter"], "radar.clutter_map": True}
    config, rng, reports = configuration(given), np.random.default_rng(6), []
    std = config.model.radars[0].noise_std
    quay = np.stack([np.linspace(2e4, 2.2e4, 30), np.linspace(0.5, 0.6, 30)], axis=1)
    for _ in range(150):
        answers = quay + rng.standard_normal(quay.shape) * std
        others = rng.uniform([1e3, -np.pi], [95e3, np.pi], (rng.poisson(6.0), 2))
        reports.append(Detections(np.concatenate([answers, others]), None))
    assert rate_of_clutter(config, reports) == pytest.approx(6.0, rel=0.25)


@pytest.mark.parametrize(
    "hidden", [{"radar.min_range": 4e4}, {"radar.blind_sectors_deg": [30.0, 120.0, 350.0, 10.0]}]
)
def test_the_rate_counts_the_clutter_that_is_too_near_or_obstructed(hidden):
    # Detections that births explain do not count.
    given = {"radar.learn": ["clutter"], "detection_births.rates": [0.01], **hidden}
    config, rng, reports = configuration(given), np.random.default_rng(6), []
    (radar,) = config.model.radars
    for _ in range(150):
        drawn = rng.uniform(
            [0.0, -np.pi], [radar.visibility.clutter_range, np.pi], (rng.poisson(10.0), 2)
        )
        reports.append(Detections(drawn[radar.visibility.probability_in_view(drawn) > 0.0], None))
    assert rate_of_clutter(config, reports) == pytest.approx(10.0, rel=0.15)


@pytest.fixture(scope="module")
def snapshot():
    tracker = engine_of()
    for _, scan in run_of(4.0, 3):
        tracker.step(scan)
    return tracker.snapshot()


def test_a_learned_rate_is_left_out_where_one_is_given_now(snapshot):
    tracker = engine_of(**rates(7.0))
    tracker.restore(snapshot)
    assert learned(tracker) == {}


def test_a_rate_may_be_learned_or_given_from_a_scan_on():
    run = [scan for _, scan in run_of(4.0, 6)]
    tracker = engine_of(**rates(4.0))
    tracker.step(run[0])
    auto = small({"lag": 0, **LEARNING})
    tracker.retune(auto.model, tracker.rule)
    tracker.step(run[1])
    begun = learned(engine_of())
    assert set(learned(tracker)) == {"radar_1", "radar_2"}
    assert all(rate != begun[radar] for radar, rate in learned(tracker).items())
