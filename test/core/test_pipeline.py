# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scenes import short_scenario, small

from phd_jdtc_ros.core.engines import new_engine
from phd_jdtc_ros.core.pipeline import RunEnded, Stepped, new_pipeline
from phd_jdtc_ros.core.scans import Rejection
from phd_jdtc_ros.core.simulation.simulate import simulate

CONFIG = small({"lag": 2})
SCANS = [scan for _, scan in simulate(short_scenario(8), 0)]
INTERVAL_NS = 6_000_000_000


def fed(pipeline, scans, later_ns=0):
    """Return all events of scans whose stamps are moved."""
    return [
        event
        for scan in scans
        for radar, detections in enumerate(scan.detections)
        for event in pipeline.add(radar, scan.stamp_ns + later_ns, detections)
    ]


def states(events):
    return [event.step.filtered[0].state for event in events]


def test_add_steps_the_engine_through_complete_scans():
    engine = new_engine(CONFIG)
    events = fed(new_pipeline(CONFIG), SCANS)
    assert [event.stamp_ns for event in events] == [scan.stamp_ns for scan in SCANS]
    for event, scan in zip(events, SCANS, strict=True):
        np.testing.assert_array_equal(
            event.step.filtered[0].state, engine.step(scan).filtered[0].state
        )


def test_add_refuses_a_report_that_came_before():
    pipeline = new_pipeline(CONFIG)
    fed(pipeline, SCANS[:2])
    again = pipeline.add(0, SCANS[1].stamp_ns, SCANS[1].detections[0])
    assert again is Rejection.DUPLICATE


def test_scans_are_stepped_when_their_events_are_asked_for():
    pipeline = new_pipeline(CONFIG)
    fed(pipeline, SCANS[:2])
    # The second radar is silent: its scan is closed by the next one's first report.
    assert list(pipeline.add(0, SCANS[2].stamp_ns, SCANS[2].detections[0])) == []
    assert pipeline.waiting
    events = pipeline.add(0, SCANS[3].stamp_ns, SCANS[3].detections[0])
    before = pipeline.engine.snapshot().stamp_ns
    next(events)
    assert (before, pipeline.engine.snapshot().stamp_ns) == tuple(s.stamp_ns for s in SCANS[1:3])


def test_close_scans_takes_in_what_waits():
    pipeline = new_pipeline(CONFIG)
    fed(pipeline, SCANS[:2])
    list(pipeline.add(0, SCANS[2].stamp_ns, SCANS[2].detections[0]))
    (event,) = pipeline.close_scans()
    assert isinstance(event, Stepped)
    assert not pipeline.waiting


def test_flush_ends_the_run_with_what_was_held_back():
    pipeline = new_pipeline(CONFIG)
    fed(pipeline, SCANS[:5])
    (ended,) = pipeline.flush()
    assert ended.reset is None
    assert [found.stamp_ns for found in ended.smoothed] == [scan.stamp_ns for scan in SCANS[3:5]]


@pytest.mark.parametrize(("intervals", "ahead"), [(-100, False), (100, True)])
def test_a_jump_of_the_stamps_ends_the_run_before_the_scan_behind_it(intervals, ahead):
    pipeline = new_pipeline(CONFIG)
    first = fed(pipeline, SCANS)
    ended, *second = fed(pipeline, SCANS, intervals * INTERVAL_NS)
    assert isinstance(ended, RunEnded)
    assert ended.reset.ahead is ahead
    assert len(ended.smoothed) == 2
    # The new run is a run of its own.
    for one, other in zip(states(first), states(second), strict=True):
        np.testing.assert_array_equal(one, other)
    numbers = [
        {number for event in run for number in event.step.filtered[0].track_id.tolist()}
        for run in (first, second)
    ]
    # Where time goes on, no number means two targets.
    assert bool(numbers[0] & numbers[1]) is not ahead


def test_a_run_begins_with_a_call_before_its_first_scan():
    begun = []
    pipeline = new_pipeline(CONFIG, lambda engine, stamp_ns: begun.append((engine, stamp_ns)))
    fed(pipeline, SCANS[:3])
    fed(pipeline, SCANS[:3], 100 * INTERVAL_NS)
    pipeline.reset()
    fed(pipeline, SCANS[:3])
    stamps = [0, 100 * INTERVAL_NS, 0]
    assert begun == [(pipeline.engine, SCANS[0].stamp_ns + moved) for moved in stamps]


def test_a_run_may_begin_where_a_snapshot_ends():
    whole, engine = new_pipeline(CONFIG), new_engine(CONFIG)
    expected = fed(whole, SCANS)
    for scan in SCANS[:4]:
        engine.step(scan)
    held = engine.snapshot()
    pipeline = new_pipeline(CONFIG, lambda engine, _: engine.restore(held))
    for one, other in zip(states(fed(pipeline, SCANS[4:])), states(expected[4:]), strict=True):
        np.testing.assert_array_equal(one, other)
