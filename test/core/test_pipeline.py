import numpy as np
import pytest
import sweep
from antennas import TurningRadar
from runs import stepped
from scenes import short_scenario, small

from phd_jdtc_ros.configuration.engines import new_engine, new_pipeline
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.intake.sectors import slices_per_revolution
from phd_jdtc_ros.core.pipeline import RunEnded, Stepped
from phd_jdtc_ros.simulation.simulate import simulate

SLICES = slices_per_revolution(4.0)
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
    assert [event.scan.stamp_ns for event in events] == [scan.stamp_ns for scan in SCANS]
    for event, scan in zip(events, SCANS, strict=True):
        np.testing.assert_array_equal(
            event.step.filtered[0].state, engine.step(scan).filtered[0].state
        )


def test_filtered_estimates_are_given_before_the_smoothing():
    order = []
    pipeline = new_pipeline(small({"lag": 2}), on_filtered=order.extend)
    pipeline.engine.forward.on_stage_end = order.append
    events = fed(pipeline, SCANS[:4])
    filtered = [found for event in events for found in event.step.filtered]
    given = [each for each in order if not isinstance(each, str)]
    # The first smoothing is that of the third scan.
    expected = [scan.stamp_ns for scan in SCANS[:3]] + ["backward", SCANS[3].stamp_ns, "backward"]
    named = [each if isinstance(each, str) else each.stamp_ns for each in order]
    assert [each for each in named if each in expected] == expected
    for one, other in zip(given, filtered, strict=True):
        np.testing.assert_array_equal(one.state, other.state)
        np.testing.assert_array_equal(one.track_id, other.track_id)


def test_add_refuses_a_report_that_came_before_even_if_cut():
    pipeline = new_pipeline(CONFIG)
    fed(pipeline, SCANS[:2])
    again = pipeline.add(0, SCANS[1].stamp_ns, SCANS[1].detections[0])
    assert again is Rejection.DUPLICATE
    pipeline = new_pipeline(small(AT_ONCE))
    reports = TURNING.reports(2)
    turned(pipeline, reports)
    again = pipeline.add(0, reports[1].stamp_ns, reports[1].detections)
    assert again is Rejection.DUPLICATE


@pytest.mark.parametrize("radars", [(0,), (1,), (0, 1)])
def test_a_copy_of_the_previous_report_is_no_new_look(radars):
    expected, pipeline, events = fed(new_pipeline(CONFIG), SCANS), new_pipeline(CONFIG), []
    for scan in SCANS:
        for later_ns in (0, INTERVAL_NS // 3, INTERVAL_NS // 2):
            for radar in (0, 1) if later_ns == 0 else radars:
                stamp_ns = scan.stamp_ns + later_ns
                events += pipeline.add(radar, stamp_ns, scan.detections[radar])
    assert [event.scan.stamp_ns for event in events] == [scan.stamp_ns for scan in SCANS]
    for one, other in zip(states(events), states(expected), strict=True):
        np.testing.assert_array_equal(one, other)
    for radar in (0, 1):
        copies = 2 * len(SCANS) if radar in radars else 0
        assert pipeline.take_anomalies(radar)["reports_repeated"] == copies


def test_a_radar_that_sends_copies_is_waited_for():
    pipeline, scans = new_pipeline(CONFIG), []
    for number, scan in enumerate(SCANS[:7]):
        slow = SCANS[number - number % 3]
        for radar, detections in ((1, scan.detections[1]), (0, slow.detections[0])):
            scans += [event.scan for event in pipeline.add(radar, scan.stamp_ns, detections)]
    assert [scan.detections[0] is not None for scan in scans] == [True, False, False] * 2 + [True]


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


def test_flush_ends_the_run_with_the_pending_estimates():
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
    # No number means two targets.
    assert numbers[0]
    assert not numbers[0] & numbers[1]


def test_a_run_begins_with_its_first_scan_or_a_snapshot():
    begun = []
    pipeline = new_pipeline(CONFIG, lambda engine, stamp_ns: begun.append((engine, stamp_ns)))
    fed(pipeline, SCANS[:3])
    fed(pipeline, SCANS[:3], 100 * INTERVAL_NS)
    pipeline.reset()
    fed(pipeline, SCANS[:3])
    stamps = [0, 100 * INTERVAL_NS, 0]
    assert begun == [(pipeline.engine, SCANS[0].stamp_ns + moved) for moved in stamps]
    whole, engine = new_pipeline(CONFIG), new_engine(CONFIG)
    expected = fed(whole, SCANS)
    stepped(engine, SCANS[:4])
    held = engine.snapshot()
    pipeline = new_pipeline(CONFIG, lambda engine, _: engine.restore(held))
    for one, other in zip(states(fed(pipeline, SCANS[4:])), states(expected[4:]), strict=True):
        np.testing.assert_array_equal(one, other)


TURNING = TurningRadar(plots=40, stamp_at=1.0)
AT_ONCE = {"lag": 2, "sensors": ["radar_1"], "interval_s": 4.0, "radar_1.rotation_s": 4.0}


def turned(pipeline, reports, radar=0):
    """Return the stamps of the scans that reports of one radar close, in seconds."""
    return [
        event.scan.stamp_ns * 1e-9
        for sent in reports
        for event in pipeline.add(radar, sent.stamp_ns, sent.detections, sent.sector)
        if isinstance(event, Stepped)
    ]


def test_revolutions_are_stepped_in_slices_again_behind_a_jump_back():
    pipeline = new_pipeline(small(AT_ONCE))
    stamps = turned(pipeline, TURNING.reports(3))
    assert len(stamps) == 3 * SLICES
    np.testing.assert_allclose(np.diff(stamps), 4.0 / SLICES, atol=0.05)
    pipeline = new_pipeline(small(AT_ONCE))
    reports = TURNING.reports(5)
    assert turned(pipeline, reports) == turned(pipeline, reports)
    pipeline.reset()
    first = turned(pipeline, reports)
    list(pipeline.flush())
    assert turned(pipeline, reports) == first


BOTH = {"lag": 2, "interval_s": 4.0, **{f"radar_{k}.rotation_s": 4.0 for k in (1, 2)}}


def two_radars(delay_s):
    """Return the reports of asynchronous radars in the order of arrival; the second's are delayed.

    Its stamps are later by 1.7 s.
    """
    arriving = [(sent.stamp_ns, 0, sent.stamp_ns, sent) for sent in TURNING.reports(6)]
    for sent in TURNING.reports(6, seed=1):
        stamp_ns = sent.stamp_ns + round(1.7e9)
        arriving.append((stamp_ns + round(delay_s * 1e9), 1, stamp_ns, sent))
    return [entry[1:] for entry in sorted(arriving, key=lambda entry: entry[0])]


@pytest.mark.parametrize("delay_s", [0.0, 3.5, 6.5])
def test_slices_are_late_and_counted_only_after_a_long_delay(delay_s):
    pipeline = new_pipeline(small(BOTH))
    scans, rejected = 0, 0
    for radar, stamp_ns, sent in two_radars(delay_s):
        events = pipeline.add(radar, stamp_ns, sent.detections)
        if isinstance(events, Rejection):
            rejected += 1
        else:
            scans += sum(isinstance(event, Stepped) for event in events)
    scans += sum(isinstance(event, Stepped) for event in pipeline.flush())
    late = sum(pipeline.take_anomalies(radar)["slices_late"] for radar in (0, 1))
    assert rejected == 0
    assert (late > 0) == (delay_s > 6.0)
    cut = small(BOTH).revolutions()
    pieces = [
        len(cut[radar].split(stamp_ns, sent.detections))
        for radar, stamp_ns, sent in two_radars(delay_s)
    ]
    assert 11 * SLICES < sum(pieces) == scans + late


def test_anomalies_are_taken_once():
    pipeline = new_pipeline(small(AT_ONCE))
    reports = TURNING.reports(4)
    turned(pipeline, [reports[0], reports[1], reports[3]])
    assert pipeline.take_anomalies(0) == {"clouds_missing": 1}
    assert not pipeline.take_anomalies(0)


def test_sectors_step_the_engine_and_gaps_are_of_revolutions():
    pipeline = new_pipeline(
        small({**AT_ONCE, "radar_1.sectors": 16, "radar_1.fields.sector": "sector"})
    )
    reports = TurningRadar(sectors=16, timed=False, cut=0.0).reports(1)
    assert turned(pipeline, reports) == [sent.stamp_ns * 1e-9 for sent in reports]
    config = small({**AT_ONCE, "interval_s": 0.25, "radar_1.sectors": 16})
    assert config.max_gap_s == 15 * 4.0
    assert config.reset_threshold_s == 3 * 4.0


@pytest.mark.parametrize("timed", [True, False])
def test_a_revolution_that_is_not_set_is_found_and_targets_are_tracked(timed):
    given = {"radar.rotation_s": 0.0, "radar.sectors": 0, "estimates_period_s": 3.9}
    pipeline = new_pipeline(sweep.configuration(given))
    found = []
    for radar, stamp_ns, detections, _ in sweep.sector_reports(8, timed):
        events = pipeline.add(radar, stamp_ns, detections)
        found += [
            one for event in events if isinstance(event, Stepped) for one in event.step.filtered
        ]
    assert pipeline.first_period_s(0) == pytest.approx(4.0, rel=0.01)
    assert pipeline.period_s(0) == pytest.approx(sweep.ROTATION_S, rel=5e-3)
    last = found[-1]
    truth = sweep.position_at(sweep.seconds_of(last.stamp_ns))
    apart = np.hypot(*(truth[:, None] - last.position).transpose(2, 0, 1)).min(axis=1)
    assert apart.max() < 500.0


def test_a_revolution_is_found_once_and_known_after_a_reset():
    given = {"radar.rotation_s": 0.0, "radar.sectors": 0}
    pipeline = new_pipeline(sweep.configuration(given))
    reports = sweep.sector_reports(6, timed=True)
    for _ in range(2):
        for radar, stamp_ns, detections, _sector in reports:
            list(pipeline.add(radar, stamp_ns, detections))
        pipeline.reset()
    assert pipeline.first_period_s(0) == pytest.approx(4.0, rel=0.01)
    assert pipeline.period_s(0) == pytest.approx(sweep.ROTATION_S, rel=5e-3)
