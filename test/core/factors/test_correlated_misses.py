"""Radars whose misses go together: the existence of targets, and the correlation that is learned.

The detections of the targets are drawn here, as a Markov chain for each target and radar.
"""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from lone import INTERVAL_S, MEAN, STD, UNREDUCED, lone, scan_at, started
from runs import learned, stepped
from scenes import small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors.correlated_misses import CorrelatedMisses, sums_of
from phd_jdtc_ros.core.factors.recent_looks import MOST, RecentLooks
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Coverage, Detections, Scan
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

DETECTION, CORRELATION, SURVIVAL = 0.75, 0.8, 0.97
NONE = np.zeros((0, 2))
RADAR = {"target.survival_probability": SURVIVAL, "radar.clutter_max_range": 5e4}
RADARS = ("radar_1", "radar_2")
START_NS = 10**12
LENGTH_S = 6.0
NOTHING = Detections(np.zeros((0, 2)), None)
BORN = {"births": [], "detection_births.rates": [0.05, 0.05]}
DETECTED = 0.7


def detectability(radar, probability, correlation, learn=()):
    """Return the parameters for a correlation, "auto" or None for independent looks."""
    words = [*learn, *["correlation"] * (correlation == "auto")]
    return {
        f"{radar}.learn": words,
        f"{radar}.detection_probability": probability,
        f"{radar}.detection_correlation": 0.0 if correlation == "auto" else correlation or 0.0,
    }


def radar_of(correlation, learn=()):
    return {**RADAR, **detectability("radar", DETECTION, correlation, learn)}


def existence_after(hits, correlation):
    """Return the existence of a target after looks that hit it at the expected place, or miss."""
    config = lone({**radar_of(correlation), **UNREDUCED, "radar.clutter_rate": 1e-9})
    engine = started(config, (0.9, MEAN, STD * 0.1))
    radar, existence = config.model.radars[0], []
    for number, hit in enumerate(hits, start=1):
        state = MEAN + number * INTERVAL_S * np.array([MEAN[1], 0.0, MEAN[3], 0.0, 0.0])
        seen = radar.measure(state[None]) if hit else NONE
        engine.step(scan_at(number * INTERVAL_S, seen))
        existence.append(float(engine.forward.unswept[-1].entry.stored.sums.existence.sum()))
    return existence


def summed(hits, correlation):
    """Return the existence, as the sum over the times at which the target may have ended.

    The clutter is so rare that a detection is the target's.
    """
    found = []
    for length in range(1, len(hits) + 1):
        weight = {False: 0.1, True: 0.0}
        for ended in range(length + 1):
            probability = 0.9 * SURVIVAL**ended * (1.0 - SURVIVAL if ended < length else 1.0)
            before = None
            for number, hit in enumerate(hits[:length]):
                own = 0.0 if number >= ended else DETECTION
                if own and before is not None:
                    own += correlation * (before - DETECTION)
                probability *= own if hit else 1.0 - own
                before = hit
            weight[ended == length] += probability
        if any(hits[:length]):
            weight[False] -= 0.1
        found.append(weight[True] / sum(weight.values()))
    return found


@pytest.mark.parametrize("correlation", [None, 0.0, CORRELATION])
def test_existence_is_the_sum_over_all_times_of_its_end(correlation):
    for hits in itertools.product([True, False], repeat=4):
        found = existence_after(hits, correlation)
        np.testing.assert_allclose(found, summed(hits, correlation or 0.0), atol=2e-4)


class Scene:
    """Targets that rest far apart, with chains of detections, and false detections.

    Each of them is there at first with the probability `START`, and ends as the model says.
    """

    START, TARGETS, CLUTTER = 0.8, 49, 20.0

    def __init__(self, seed, scans=30, survival=SURVIVAL):
        rng, self.survival, self.results = np.random.default_rng(seed), survival, {}
        place = np.stack(np.meshgrid(*[np.linspace(-3e4, 3e4, 7)] * 2), axis=-1).reshape(-1, 2)
        self.mean = np.zeros((self.TARGETS, 5))
        self.mean[:, [0, 2]] = place + 500.0
        config = self.config(None)
        radar = config.model.radars[0]
        self.there = rng.random(self.TARGETS) < self.START
        self.alive, self.scans, hit = [], [], None
        for number in range(1, scans + 1):
            self.there = self.there & (rng.random(self.TARGETS) < survival)
            before = DETECTION if hit is None else hit
            hit = rng.random(self.TARGETS) < DETECTION + CORRELATION * (before - DETECTION)
            seen = radar.measure(self.mean[self.there & hit])
            noisy = seen + rng.standard_normal(seen.shape) * radar.noise_std
            false = rng.uniform([0.0, -np.pi], [5e4, np.pi], (rng.poisson(self.CLUTTER), 2))
            self.scans.append(scan_at(number * INTERVAL_S, np.concatenate([noisy, false])))
            self.alive.append(self.there)

    def config(self, *given):
        motion = {"cv.noise_density": 1e-6, "radar.clutter_rate": self.CLUTTER}
        motion["target.survival_probability"] = self.survival
        return lone({**radar_of(*given), **motion, "accuracy": "normal"})

    def engine(self, *given):
        std = np.array([50.0, 1e-3, 50.0, 1e-3, 0.0])
        return started(self.config(*given), *((self.START, each, std) for each in self.mean))

    def existence(self, *given):
        """Return the existence of every target after every scan, and the last figures.

        For what may be given see `radar_of`.
        """
        if given not in self.results:
            self.results[given] = self._tracked(*given)
        return self.results[given]

    def _tracked(self, *given):
        engine, found = self.engine(*given), []
        for scan in self.scans:
            figures = engine.step(scan).figures
            stored = engine.forward.unswept[-1].entry.stored
            each = np.zeros(self.TARGETS)
            each[stored.sums.label] = stored.sums.existence
            found.append(each)
        return np.array(found), figures


@pytest.fixture(scope="module")
def scenes():
    return [Scene(seed) for seed in range(8)]


def miscalibration(scenes, correlation):
    """Return the largest difference of said and true existence over bins of at least 100."""
    said = np.concatenate([scene.existence(correlation)[0].ravel() for scene in scenes])
    true = np.concatenate([np.ravel(scene.alive) for scene in scenes])
    part = np.minimum((10.0 * said).astype(int), 9)
    return max(
        abs(said[part == one].mean() - true[part == one].mean())
        for one in range(10)
        if (part == one).sum() >= 100
    )


def test_existence_is_calibrated_where_misses_go_together(scenes):
    assert miscalibration(scenes, CORRELATION) < 0.08
    assert miscalibration(scenes, None) > 0.2


@pytest.fixture(scope="module")
def long_scenes():
    return [Scene(seed, scans=100, survival=0.995) for seed in range(100, 104)]


def test_correlation_is_found_and_existence_calibrated_with_it(long_scenes):
    found, name = (
        [scene.existence("auto")[1] for scene in long_scenes],
        "radar.detection_correlation",
    )
    normal = [(each[name] - CORRELATION) / each[f"{name}_std"] for each in found]
    assert np.sqrt(np.mean(np.square(normal))) < 2.0
    assert miscalibration(long_scenes, "auto") < 0.6 * miscalibration(long_scenes, None)


def test_detection_probability_is_found_although_misses_go_together(long_scenes):
    """Long runs of misses count, in which targets are improbable for a while."""
    name = "radar.detection_probability"
    found = [scene.existence(CORRELATION, ("detection",))[1] for scene in long_scenes]
    normal = [(each[name] - DETECTION) / each[f"{name}_std"] for each in found]
    assert np.sqrt(np.mean(np.square(normal))) < 2.5


def two_radars(correlation):
    of_radars = {}
    for radar in RADARS:
        of_radars |= detectability(radar, 0.8, correlation)
    return new_engine(small(of_radars))


def scans_of_two(seed, scans):
    radars = small({f"{radar}.detection_probability": 0.8 for radar in RADARS}).model.radars
    scenario = replace(paper_scenario(radars), scans=scans)
    return [scan for _, scan in simulate(scenario, seed)]


def test_correlation_is_reported_once_pairs_of_looks_show_it():
    radar, half = lone(radar_of("auto")).model.radars[0], np.full(8, 0.5)
    always, at_times = np.ones(8), np.array([1.0, 0.0] * 4)
    for detected, names in ((always, set()), (at_times, {"", "_std"})):
        sums = sums_of(detected, np.roll(detected, 1), half, half).sum(axis=0)
        figures = CorrelatedMisses(0.0, True).after(sums).figures(radar)
        assert set(figures) == {f"detection_correlation{name}" for name in names}


def test_last_looks_are_bounded_and_independent_misses_teach_nothing():
    engine = two_radars("auto")
    figures = [engine.step(scan) for scan in scans_of_two(5, 60)][-1].figures
    for radar in RADARS:
        assert figures[f"{radar}.detection_correlation"] < 0.1
    engine = two_radars("auto")
    stepped(engine, scans_of_two(7, 60))
    living = sum(len(np.unique(rows.row_label)) for rows in engine.forward.unswept)
    assert (
        max(len(each.chains) for each in learned(engine, CorrelatedMisses).values())
        < 2 * living + 300
    )


def config_of(accuracy="normal", **given):
    radars = {f"radar_1.{name}": value for name, value in given.items()}
    probability = {"radar_1.detection_probability": DETECTED, "radar_2.detection_probability": 0.6}
    given = {"accuracy": accuracy, "amplitude": "none", **BORN}
    return small({**given, **probability, **radars})


def odds_of_birth(config, looks=(), coverage=None):
    """Return the odds that the second radar's detection is a new target.

    The radar has seen nothing before, `LENGTH_S` earlier; the first one sees nothing in between, at
    the times of `looks`.
    """
    engine = new_engine(config)
    engine.step(Scan(START_NS, (NOTHING, NOTHING)))
    for time_s in looks:
        seen = Detections(np.zeros((0, 2)), None, coverage=coverage)
        engine.step(Scan(START_NS + round(1e9 * time_s), (seen, None)))
    found = Detections(np.array([[6e3, 0.5]]), None)
    step = engine.step(Scan(START_NS + round(1e9 * LENGTH_S), (None, found)))
    mass = step.class_mass.sum()
    return mass / (1.0 - mass)


@pytest.mark.parametrize(
    ("coverage", "given"),
    [
        pytest.param(None, {"min_range": 3e4, "max_range": 5e4}, id="out of range"),
        pytest.param(Coverage(2.0, 1.0), {}, id="in another sector"),
    ],
)
def test_looks_elsewhere_leave_births_as_they_are(coverage, given):
    config = config_of(**given)
    hidden = odds_of_birth(config, [1.0, 2.0, 4.5], coverage)
    assert hidden == pytest.approx(odds_of_birth(config), rel=1e-9)


@pytest.mark.parametrize("looks", [[5.0], [1.0, 2.0, 4.5]])
def test_looks_at_the_place_leave_the_unknown_targets_that_they_missed(looks):
    rng, config = np.random.default_rng(1), config_of()
    appeared = rng.uniform(0.0, LENGTH_S, 200_000)
    missed = rng.random((len(looks), len(appeared))) >= DETECTED
    unknown = (missed | (np.array(looks)[:, None] < appeared)).all(axis=0).mean()
    found = odds_of_birth(config, looks) / odds_of_birth(config)
    assert found == pytest.approx(unknown, rel=0.02)


@pytest.mark.parametrize("accuracy", ["fast", "normal"])
@pytest.mark.parametrize(
    ("place", "same_start", "relative", "metres"),
    [
        pytest.param([0.0, -150e3], False, 1e-12, 1e-6, id="far from all"),
        # Improbable targets of unknown position may be in its field, so that they are predicted and
        # merged at its looks too. The two engines begin each scan from the same state.
        pytest.param([0.0, 0.0], True, 1e-4, 0.3, id="amidst"),
    ],
)
def test_a_sensor_that_can_see_no_target_changes_no_estimate(
    place, same_start, relative, metres, accuracy
):
    blind = {"min_range": 20.0, "max_range": 60.0, "clutter_max_range": 60.0}
    config = config_of(accuracy=accuracy, position=place, **blind)
    alone, beside = new_engine(config), new_engine(config)
    known = 0
    for number, (_, scan) in enumerate(simulate(paper_scenario(config_of().model.radars), 4)[:25]):
        if same_start and number:
            beside.restore(alone.snapshot())
        seen = replace(scan, detections=(None, scan.detections[1]))
        for before_s in (2.0, 1.1, 0.3):
            stamp_ns = scan.stamp_ns - round(1e9 * before_s)
            beside.step(Scan(stamp_ns, (NOTHING, None)))
        (ours,), (theirs,) = alone.step(seen).filtered, beside.step(seen).filtered
        np.testing.assert_allclose(theirs.weight, ours.weight, rtol=relative)
        np.testing.assert_allclose(theirs.state, ours.state, rtol=relative, atol=metres)
        known += len(ours)
    assert known > 40


def test_a_scan_in_which_no_sensor_reported_is_refused_and_changes_nothing():
    refused, unchanged = new_engine(config_of()), new_engine(config_of())
    for scan in alternating(4):
        with pytest.raises(ValueError, match=r"scan\.detections: no sensor reported"):
            refused.step(Scan(scan.stamp_ns - 10**8, (None, None)))
        ours, theirs = refused.step(scan), unchanged.step(scan)
        np.testing.assert_array_equal(ours.filtered[0].state, theirs.filtered[0].state)
        np.testing.assert_array_equal(ours.class_mass, theirs.class_mass)
    assert len(ours.filtered[0])


def alternating(count=12):
    """Return scans in which the radars look in turn, twice the first and once the second."""
    run = simulate(paper_scenario(config_of().model.radars), 4)[:count]
    return [
        Scan(scan.stamp_ns, (None, seen[1]) if number % 3 == 2 else (seen[0], None))
        for number, (_, scan) in enumerate(run)
        for seen in [scan.detections]
    ]


def test_snapshot_with_a_look_of_no_sensor_is_refused():
    engine = new_engine(config_of())
    stepped(engine, alternating(4))
    snapshot = engine.snapshot()
    snapshot.arrays["recent_looks.sensor"] = np.full(4, 2)
    with pytest.raises(ValueError, match=r"recent_looks.sensor: must be below .* sensors, 2"):
        new_engine(config_of()).restore(snapshot)


def test_looks_are_bounded_and_none_of_a_lone_sensor():
    (first, second), looks = config_of().model.radars, RecentLooks.of_none()
    looks = looks.after(View.of(second, NOTHING, START_NS), 1)
    for number in range(1, MOST + 1):
        assert looks.since_last(View.of(second, NOTHING, START_NS + number), 1) is not None
        looks = looks.after(View.of(first, NOTHING, START_NS + number), 0)
    assert len(looks.stamp_ns) == MOST
    assert looks.since_last(View.of(second, NOTHING, START_NS + MOST + 1), 1) is None
    config = small({"sensors": ["radar_1"], **BORN})
    engine = new_engine(config)
    for number in range(3):
        engine.step(Scan(START_NS + number * 10**9, (NOTHING,)))
    assert engine.forward.factors.looks is None
