"""Reports with far more detections than usual: jamming, rain, a faulty plot extractor."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors.clutter.rate import Bursts
from phd_jdtc_ros.core.factors.factor import Look
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import FULL_TURN, Coverage, Detections
from phd_jdtc_ros.core.types.detections import UNKNOWN_COVERAGE
from phd_jdtc_ros.evaluation.metrics import ospa
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

RADAR = small().model.radars[0]
USUAL, FEW_REVOLUTIONS = 30, int(Bursts.KNOWN_REVOLUTIONS)
NONE = np.zeros(0, dtype=np.int64)


def report_of(count, coverage=None):
    return View.of(RADAR, Detections(np.full((count, 2), [5e3, 0.0]), None, coverage=coverage))


def after_report(bursts, report):
    """Return what is usual after a report, of which the update uses a few detections only."""
    return bursts.learn(
        Look(report.take(np.arange(len(report))[:1]), report, None, None, NONE, None)
    )


def after(*numbers):
    bursts = Bursts()
    for number in numbers:
        bursts = after_report(bursts, report_of(number))
    return bursts


def clutter_rate(bursts, count, coverage=None):
    return bursts.given(report_of(count, coverage), None).clutter_rate


def test_detections_far_beyond_the_usual_number_are_clutter_until_usual():
    bursts = after(*[USUAL] * 20)
    expected = RADAR.clutter_rate + 1000 - USUAL - 5.0 * np.sqrt(1000)
    assert clutter_rate(bursts, 1000) == pytest.approx(expected, rel=0.01)
    bursts = after(*[USUAL] * 20, *[1000] * 200)
    assert clutter_rate(bursts, 1000) == RADAR.clutter_rate


@pytest.mark.parametrize("usual", [2.0, 40.0, 900.0])
def test_usual_numbers_change_nothing(usual):
    rng, bursts = np.random.default_rng(3), Bursts()
    for number in rng.poisson(usual, 500):
        assert clutter_rate(bursts, number) == RADAR.clutter_rate
        bursts = after_report(bursts, report_of(number))


@pytest.mark.parametrize(
    ("revolutions", "known"), [(0, False), (1, False), (FEW_REVOLUTIONS + 1, True)]
)
def test_nothing_is_usual_at_the_start(revolutions, known):
    assert (clutter_rate(after(*[USUAL] * revolutions), 1000) > RADAR.clutter_rate) == known


def test_sectors_are_compared_with_their_part_of_a_revolution_if_known():
    sector = Coverage(0.0, FULL_TURN / 16.0)
    bursts = Bursts()
    for _ in range(16 * 20):
        bursts = after_report(bursts, report_of(2, sector))
    assert clutter_rate(bursts, 4, sector) == RADAR.clutter_rate
    expected = RADAR.clutter_rate + 16.0 * (100 - 2 - 5.0 * np.sqrt(100))
    assert clutter_rate(bursts, 100, sector) == pytest.approx(expected, rel=0.01)
    bursts = after(*[USUAL] * 20)
    assert after_report(bursts, report_of(1000, UNKNOWN_COVERAGE)) == bursts
    assert clutter_rate(bursts, 1000, UNKNOWN_COVERAGE) == RADAR.clutter_rate


def bursting(count, burst):
    """Return truth and scans of the reference scenario with a burst at these scans."""
    radars = small().model.radars
    loud = tuple(replace(radar, clutter_rate=600.0) for radar in radars)
    quiet, crowded = (simulate(paper_scenario(each), 5)[:count] for each in (radars, loud))
    return [crowded[k] if k in burst else quiet[k] for k in range(count)]


def test_targets_are_tracked_through_a_burst_without_false_ones():
    burst = range(24, 30)
    births = {"detection_births.rates": [0.01, 0.01]}
    tracker = new_engine(small({"lag": 0, **births}))
    distances = []
    for index, (truth, scan) in enumerate(bursting(30, burst)):
        (found,) = tracker.step(scan).filtered
        if index in burst:
            distances.append(ospa(truth.position, found.position, 1000.0, 2.0).distance)
    # With a false target beside the four true ones the distance is above 447 m.
    assert max(distances) < 447.0
