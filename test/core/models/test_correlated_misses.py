"""Radars whose misses go together: the existence of targets, and the correlation that is learned.

The detections of the targets are drawn here, as a Markov chain for each target and radar.
"""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from lone import INTERVAL_S, MEAN, STD, UNREDUCED, lone, scan_at, started
from runs import ENGINES, learned, restored_after, step_and_reprocess, stepped
from scenes import small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

DETECTION, CORRELATION, SURVIVAL = 0.75, 0.8, 0.97
NONE = np.zeros((0, 2))


RADAR = {"target.survival_probability": SURVIVAL, "radar.clutter_max_range": 5e4}


def detectability(probability, correlation):
    """Return the parameter for a correlation, "auto" or None for independent looks."""
    given = "" if correlation == "auto" else correlation
    return probability if correlation is None else f"{probability} correlated {given}"


def radar_of(correlation, probability=DETECTION):
    return {**RADAR, "radar.detection_probability": detectability(probability, correlation)}


def existence_after(hits, correlation):
    """Return the existence of a target after looks that hit it at the expected place, or miss."""
    config = lone({**radar_of(correlation), **UNREDUCED, "radar.clutter_rate": 1e-9})
    engine = started(config, (0.9, MEAN, STD * 0.1))
    radar, existence = config.model.radars[0], []
    for number, hit in enumerate(hits, start=1):
        state = MEAN + number * INTERVAL_S * np.array([MEAN[1], 0.0, MEAN[3], 0.0, 0.0])
        seen = radar.measure(state[None]) if hit else NONE
        engine.step(scan_at(number * INTERVAL_S, seen))
        existence.append(float(engine.forward.unswept[-1].entry.stored.existence.sum()))
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
        rng, self.survival = np.random.default_rng(seed), survival
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
        engine, found = self.engine(*given), []
        for scan in self.scans:
            figures = engine.step(scan).figures
            stored = engine.forward.unswept[-1].entry.stored
            each = np.zeros(self.TARGETS)
            each[stored.label] = stored.existence
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
    name, auto = "radar.detection_probability", f"auto {DETECTION}"
    found = [scene.existence(CORRELATION, auto)[1] for scene in long_scenes]
    normal = [(each[name] - DETECTION) / each[f"{name}_std"] for each in found]
    assert np.sqrt(np.mean(np.square(normal))) < 2.5


RADARS = ("radar_1", "radar_2")


def two_radars(engine, correlation):
    given = detectability(0.8, correlation)
    of_radars = {f"{radar}.detection_probability": given for radar in RADARS}
    return new_engine(small({"engine": engine, "particles_per_target": 200, **of_radars}))


def scans_of_two(seed, scans):
    radars = small({f"{radar}.detection_probability": 0.8 for radar in RADARS}).model.radars
    scenario = replace(paper_scenario(radars), scans=scans)
    return [scan for _, scan in simulate(scenario, seed)]


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("correlation", [0.6, "auto"])
def test_restored_engine_goes_on_with_the_last_looks(engine, correlation):
    restored_after(9, lambda: two_radars(engine, correlation), scans_of_two(3, 16))


def test_reprocessed_scans_have_the_last_looks_of_their_order():
    scans = scans_of_two(3, 16)
    straight, late = two_radars("gaussian", "auto"), two_radars("gaussian", "auto")
    stepped(straight, scans)
    step_and_reprocess(late, scans, 10)
    assert late.forward.learned_figures == straight.forward.learned_figures


def test_particles_learn_as_gaussians_do():
    scans, found = scans_of_two(2, 25), []
    for scan in scans:
        shown = [each.take(np.arange(len(each)) % 4 > 0) for each in scan.detections]
        found.append(replace(scan, detections=tuple(shown)))
    last = {}
    for engine in ENGINES:
        tracker = two_radars(engine, 0.5)
        stepped(tracker, found)
        last[engine] = learned(tracker, "chains")["radar_1"]
    sure = [np.sort(each.detected[each.detected > 0.9]) for each in last.values()]
    assert len(sure[0]) == len(sure[1]) > 0


def test_last_looks_are_bounded_and_independent_misses_teach_nothing():
    engine = two_radars("gaussian", "auto")
    figures = [engine.step(scan) for scan in scans_of_two(5, 60)][-1].figures
    for radar in RADARS:
        assert figures[f"{radar}.detection_correlation"] < 0.1
    engine = two_radars("gaussian", "auto")
    stepped(engine, scans_of_two(7, 60))
    living = sum(len(np.unique(rows.row_label)) for rows in engine.forward.unswept)
    assert max(len(chains) for chains in learned(engine, "chains").values()) < 2 * living + 300
