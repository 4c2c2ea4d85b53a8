"""A turning antenna passes a target once, in whichever of two sectors its plot is measured."""

import itertools
from functools import cache

import numpy as np
import pytest
from lone import lone, mixture_of
from runs import ENGINES
from scenes import intensity
from scipy.stats import norm

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.learned.detection_chains import Look
from phd_jdtc_ros.core.models.sensor_memory import SensorMemory
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.smc.correction import BERNOULLI
from phd_jdtc_ros.core.smc.update import ParticleSteps
from phd_jdtc_ros.core.types import FULL_TURN, Coverage, Detections, Scan
from phd_jdtc_ros.core.window.update import update_scan

EXISTENCE, DETECTION_PROBABILITY, EDGE = 0.9, 0.9, 0.6
MEAN = np.array([7e3 * np.cos(EDGE), 0.0, 7e3 * np.sin(EDGE), 0.0, 0.0])
STD = np.array([120.0, 5.0, 120.0, 5.0, 1e-3])
CONFIG = lone(
    {
        "radar.detection_probability": DETECTION_PROBABILITY,
        "radar.position": [0.0, 0.0],
        "radar.yaw_deg": 0.0,
        "radar.rotation_s": 4.0,
        "radar.sectors": 16,
        "radar.clutter_rate": 2e3,
    }
)
(RADAR,) = CONFIG.model.radars
# The two sectors in the order of an antenna that turns counter-clockwise, and the plots of each.
SECTORS = (Coverage(EDGE - 0.4, 0.4), Coverage(EDGE, 0.4))
PLOTS = {
    "none": ([], []),
    "before": ([[7.1e3, EDGE - 0.005]], []),
    "after": ([], [[6.9e3, EDGE + 0.004]]),
    "both": ([[7.1e3, EDGE - 0.002]], [[6.9e3, EDGE + 0.003]]),
}


def drawn(count):
    return MEAN + STD * np.random.default_rng(7).standard_normal((count, len(MEAN)))


def prior(engine):
    """Return the steps of an engine, and a target at the edge as its rows."""
    if engine == "gaussian":
        dynamics = Dynamics(CONFIG.model)
        mixture = mixture_of(dynamics, [(EXISTENCE, MEAN, STD)])
        rows = Branched(mixture, np.arange(len(mixture)))
        return GaussianSteps(dynamics, new_engine(CONFIG).forward.bounds), rows
    states = drawn(20_000)
    weight = np.full(len(states), EXISTENCE / len(states))
    rows = intensity(states, weight)
    return ParticleSteps(CONFIG.model, BERNOULLI, np.random.default_rng(1)), rows


def existence_of(rows):
    return float(rows.mixture.mass.sum() if isinstance(rows, Branched) else rows.weight.sum())


def swept(engine, sectors, plots, between_s=0.25):
    """Return the existence probability after reports of sectors, one after the other."""
    steps, rows = prior(engine)
    memory = SensorMemory((RADAR.name,))
    for index, (sector, found) in enumerate(zip(sectors, plots, strict=True)):
        report = Detections(np.reshape(found, (-1, 2)), None, coverage=sector)
        scan = Scan(10**12 + round(index * between_s * 1e9), (report,))
        rows = update_scan(rows, scan, steps, 4.0, index, memory).rows
    return existence_of(rows)


@cache
def exact(name):
    """Return the existence probability after a turn: at most one of all plots is the target's."""
    measured = RADAR.measure(drawn(400_000))
    clutter = np.exp(RADAR.log_uniform_clutter)
    exists = EXISTENCE * (1.0 - DETECTION_PROBABILITY)
    for plot in itertools.chain(*PLOTS[name]):
        error = np.array(plot) - measured
        error[:, 1] = wrap_angle(error[:, 1])
        density = norm.pdf(error / RADAR.noise_std).prod(axis=1) / RADAR.noise_std.prod()
        exists += EXISTENCE * DETECTION_PROBABILITY * density.mean() / clutter
    return exists / (1.0 - EXISTENCE + exists)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", PLOTS)
@pytest.mark.parametrize("clockwise", [False, True])
def test_existence_after_two_sectors_is_that_of_a_whole_turn(engine, name, clockwise):
    way = -1 if clockwise else 1
    found = swept(engine, SECTORS[::way], PLOTS[name][::way])
    assert found == pytest.approx(exact(name), abs=0.03)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", PLOTS)
@pytest.mark.parametrize("overlap", [0.004, 0.018])
def test_sectors_that_overlap_pass_a_target_once(engine, name, overlap):
    sectors = Coverage(EDGE - 0.4, 0.4 + 0.5 * overlap), Coverage(EDGE - 0.5 * overlap, 0.4)
    for way in (1, -1):
        found = swept(engine, sectors[::way], PLOTS[name][::way])
        assert found == pytest.approx(exact(name), abs=0.03)


@pytest.mark.parametrize("engine", ENGINES)
def test_miss_of_the_next_turn_counts_again(engine):
    found = swept(engine, SECTORS[:1] * 2, ([], []), between_s=4.0)
    once = swept(engine, SECTORS[:1], ([],))
    assert found < once - 0.05


def report_of(sector, stamp_ns):
    return Report(RADAR, Detections(np.zeros((0, 2)), None, coverage=sector), stamp_ns)


def learn(memory, report, label, detected):
    """Learn with which probability a report has detected targets."""
    one = np.ones(len(label))
    look = Look(np.array(label), one, np.array(detected), 0.0 * one, one, one > 0.0)
    memory.learn_look(memory.prepare(report), look)


def test_sector_that_does_not_adjoin_is_not_conditioned():
    memory = SensorMemory((RADAR.name,))
    report = report_of(SECTORS[0], 10**12)
    learn(memory, report, [3], [0.7])
    later = 10**12 + 10**9
    assert memory.prepare(report_of(Coverage(EDGE + 1.5, 0.4), later)).earlier_sectors is None
    earlier = memory.prepare(report_of(SECTORS[1], later)).earlier_sectors
    assert earlier.coverage.start == pytest.approx(SECTORS[0].start)
    assert earlier.coverage.width == SECTORS[0].width
    continued = earlier.continued
    assert (continued.label.tolist(), continued.unseen.tolist()) == ([3], [pytest.approx(0.3)])


def test_pass_remembers_half_a_turn():
    memory = SensorMemory((RADAR.name,))
    for sector in range(20):
        coverage = Coverage(wrap_angle(np.array(0.4 * sector)).item(), 0.4)
        stamp_ns = 10**12 + round(sector * 4e9 * 0.4 / FULL_TURN)
        learn(memory, report_of(coverage, stamp_ns), [sector], [1.0])
    latest = memory.sensors[RADAR.name].antenna_pass
    assert latest.width == pytest.approx(np.pi)
    assert latest.label.tolist() == list(range(12, 20))


def test_halves_of_a_turn_are_not_conditioned():
    memory = SensorMemory((RADAR.name,))
    first, second = (Coverage(start, np.pi) for start in (-np.pi, 0.0))
    learn(memory, report_of(first, 10**12), [3], [0.7])
    assert memory.prepare(report_of(second, 10**12 + 10**9)).earlier_sectors is None
