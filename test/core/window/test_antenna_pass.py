"""A turning antenna passes a target once, in whichever of two sectors its plot is measured."""

import itertools
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from lone import lone, mixture_of
from scipy.stats import norm

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.arrays import wrap_angle
from phd_jdtc_ros.core.factors import Sectors
from phd_jdtc_ros.core.factors.factor import Look
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.sensors.view import View
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


def swept(sectors, plots, between_s=0.25):
    """Return the existence probability after reports of sectors, one after the other."""
    dynamics = Dynamics(CONFIG.model)
    mixture = mixture_of(dynamics, [(EXISTENCE, MEAN, STD)])
    rows = Branched(mixture, np.arange(len(mixture)))
    steps = GaussianSteps(dynamics, new_engine(CONFIG).forward.bounds)
    factors = new_engine(CONFIG).forward.factors
    for index, (sector, found) in enumerate(zip(sectors, plots, strict=True)):
        report = Detections(np.reshape(found, (-1, 2)), None, coverage=sector)
        scan = Scan(10**12 + round(index * between_s * 1e9), (report,))
        updated = update_scan(rows, steps.model.reports(scan), steps, 4.0, index, factors)
        rows, factors = updated.rows, updated.factors
    return rows.mixture.sums.mass.sum()


@cache
def exact(name):
    """Return the existence probability after a revolution: at most one plot is the target's."""
    measured = RADAR.measure(MEAN + STD * np.random.default_rng(7).standard_normal((400_000, 5)))
    clutter = np.exp(RADAR.visibility.log_clutter(RADAR.clutter_rate))
    exists = EXISTENCE * (1.0 - DETECTION_PROBABILITY)
    for plot in itertools.chain(*PLOTS[name]):
        error = np.array(plot) - measured
        error[:, 1] = wrap_angle(error[:, 1])
        density = norm.pdf(error / RADAR.noise_std).prod(axis=1) / RADAR.noise_std.prod()
        exists += EXISTENCE * DETECTION_PROBABILITY * density.mean() / clutter
    return exists / (1.0 - EXISTENCE + exists)


@pytest.mark.parametrize("name", PLOTS)
@pytest.mark.parametrize("clockwise", [False, True])
def test_existence_after_two_sectors_is_that_of_a_whole_revolution(name, clockwise):
    way = -1 if clockwise else 1
    found = swept(SECTORS[::way], PLOTS[name][::way])
    assert found == pytest.approx(exact(name), abs=0.03)


@pytest.mark.parametrize("name", PLOTS)
@pytest.mark.parametrize("overlap", [0.004, 0.018])
def test_sectors_that_overlap_pass_a_target_once(name, overlap):
    sectors = Coverage(EDGE - 0.4, 0.4 + 0.5 * overlap), Coverage(EDGE - 0.5 * overlap, 0.4)
    for way in (1, -1):
        found = swept(sectors[::way], PLOTS[name][::way])
        assert found == pytest.approx(exact(name), abs=0.03)


def test_miss_of_the_next_revolution_counts_again():
    found = swept(SECTORS[:1] * 2, ([], []), between_s=4.0)
    once = swept(SECTORS[:1], ([],))
    assert found < once - 0.05


def report_of(sector, stamp_ns):
    return View.of(RADAR, Detections(np.zeros((0, 2)), None, coverage=sector), stamp_ns)


def after(sectors, report, label, detected):
    """Return the pass after a report that has detected certain targets with these probabilities."""
    row, one, view = np.arange(len(label)), np.ones(len(label)), sectors.expect(report)
    targets = SimpleNamespace(label=np.array(label), target=row, existence=one)
    found = SimpleNamespace(
        claims=SimpleNamespace(row=row), pair_probability=np.array(detected), existence=one
    )
    return sectors.learn(Look(view, view, targets, found, np.zeros(0, dtype=np.int64), None))


def test_sector_that_does_not_adjoin_is_not_conditioned():
    sectors = after(Sectors(), report_of(SECTORS[0], 10**12), [3], [0.7])
    later = 10**12 + 10**9
    assert sectors.expect(report_of(Coverage(EDGE + 1.5, 0.4), later)).earlier_sectors is None
    earlier = sectors.expect(report_of(SECTORS[1], later)).earlier_sectors
    assert earlier.coverage.start == pytest.approx(SECTORS[0].start)
    assert earlier.coverage.width == SECTORS[0].width
    continued = earlier.continued
    assert (continued.label.tolist(), continued.unseen.tolist()) == ([3], [pytest.approx(0.3)])


def test_pass_remembers_half_a_revolution():
    sectors = Sectors()
    for sector in range(20):
        coverage = Coverage(wrap_angle(np.array(0.4 * sector)).item(), 0.4)
        stamp_ns = 10**12 + round(sector * 4e9 * 0.4 / FULL_TURN)
        sectors = after(sectors, report_of(coverage, stamp_ns), [sector], [1.0])
    assert sectors.latest.width == pytest.approx(np.pi)
    assert sectors.latest.label.tolist() == list(range(12, 20))


def test_halves_of_a_revolution_are_not_conditioned():
    first, second = (Coverage(start, np.pi) for start in (-np.pi, 0.0))
    sectors = after(Sectors(), report_of(first, 10**12), [3], [0.7])
    assert sectors.expect(report_of(second, 10**12 + 10**9)).earlier_sectors is None
