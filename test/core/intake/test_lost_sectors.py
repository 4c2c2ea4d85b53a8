"""A lost sector is no miss of its targets; an empty one is."""

import numpy as np
import pytest
import sweep

from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, Detections

TURNS = 6
NONE = Detections(np.zeros((0, 2)), None, np.zeros(0))
# The sector in which the second target is, in the last turn and the one before.
PASSED = 8
GIVEN = {
    "lag": "4 s",
    "radar.clutter_rate": 48.0,
    "estimates_period_s": 3.9,
    # With 200, one of three runs loses a target.
    "particles_per_target": 500,
}


def found_of(engine, reports, numbered):
    """Return the last filtered estimates, and what was noticed."""
    pipeline = new_pipeline(sweep.configuration({**GIVEN, "engine": engine}))
    found = []
    for radar, stamp_ns, detections, sector in reports:
        events = pipeline.add(radar, stamp_ns, detections, sector if numbered else None)
        found += [
            one for event in events if isinstance(event, Stepped) for one in event.step.filtered
        ]
    return found[-1], pipeline.take_anomalies(0)


def of_target(estimates, target=1):
    truth = sweep.position_at(sweep.seconds_of(estimates.stamp_ns))[target]
    apart = np.hypot(*(estimates.position - truth).T)
    assert apart.min() < 1000.0
    return int(apart.argmin())


@pytest.mark.parametrize(
    ("engine", "numbered"), [("particles", True), ("gaussian", True), ("gaussian", False)]
)
def test_a_lost_sector_is_no_miss_and_an_empty_one_is(engine, numbered):
    reports = sweep.sector_reports(TURNS, timed=True)
    begin = (TURNS - 2) * sweep.SECTORS
    passed = [begin + turn * sweep.SECTORS + PASSED + k for turn in (0, 1) for k in (-1, 0)]
    empty = [
        (*report[:2], NONE, report[3]) if index in passed else report
        for index, report in enumerate(reports)
    ]
    lost = [report for index, report in enumerate(reports) if index not in passed]

    (whole, _), (without, noticed), (missed, counted) = (
        found_of(engine, sent, numbered) for sent in (reports, lost, empty)
    )
    assert (noticed["clouds_missing"], counted["clouds_missing"]) == (4, 0)
    weight = [each.weight[of_target(each)] for each in (whole, without)]
    # Nothing but survival speaks against it.
    assert weight[1] > 0.99 * weight[0]
    state = without.track_state[of_target(without)]
    assert state in (CONFIRMED, COASTING)
    truth = sweep.position_at(sweep.seconds_of(missed.stamp_ns))[1]
    near = np.hypot(*(missed.position - truth).T) < 1000.0
    assert (1.0 - missed.weight[near] > 1.5 * (1.0 - weight[1])).all()
