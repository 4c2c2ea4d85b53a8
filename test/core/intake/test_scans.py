import re

import numpy as np
import pytest
import sweep
from hypothesis import given, settings
from hypothesis import strategies as st

from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.core.intake.scans import Rejection, Reset, ScanGrouper
from phd_jdtc_ros.core.intake.sectors import coverage_of, is_sector, sector_of
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.core.sensors.visibility import sector_probability
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, Detections, Scan

S = 1_000_000_000
START = 1_700_000_000 * S
# Groupers' options; and, by what they show, reports before and those with what follows from them.
STREAMS = [
    (
        {},
        """
        a later stamp closes a scan:
            | 0@0; 0@6: 0/0; 1@6: 6/01
        a radar that missed two scans is not waited for:
            0@0 1@0 | 0@6; 0@12: 6/0; 0@18: 12/0 18/0; 0@24: 24/0
        a radar that returns is waited for again:
            0@0 1@0 0@6 0@12 0@18 | 1@24; 0@24: 24/01; 0@30; 1@30: 30/01
        a radar whose first report back is late is waited for again:
            0@0 1@0 0@6 0@12 0@18 | 1@18: late; 0@24; 1@24: 24/01
        a radar that reports at every fifth stamp is waited for then:
            1@0 0@0 1@5 0@5 0@6 0@7 0@8 0@9 | 0@10; 1@10: 10/01; 0@11; 0@12: 11/0
        a radar that has missed two of its own intervals is not waited for:
            1@0 0@0 1@5 0@5 0@8 0@9 0@10 0@14 0@15 0@16 | 0@17: 17/0; 0@20: 20/0
        a duplicate is rejected before its scan closed and after:
            | 0@0; 0@0: duplicate; 1@0: 0/01; 1@0: duplicate; 0@0: duplicate
        a late report is rejected:
            | 0@0; 0@6: 0/0; 1@0: late; 1@6: 6/01
        stamps that jump back are one reset:
            0@100 1@100 | 0@0: reset; 1@0: 0/01; 0@6; 1@6: 6/01
        a jump back closes what waits:
            0@100 1@100 0@106 | 0@0: 106/0 reset; 1@0: 0/01; 0@6; 1@6: 6/01
        every radar is live after a reset:
            0@100 1@100 0@106 0@112 0@118 | 0@0: reset; 1@0: 0/01
        """,
    ),
    (
        {"max_gap_s": 30.0},
        """
        both radars are taken in after a gap:
            0@0 1@0 | 0@100; 1@100: reset 100/01; 0@106; 1@106: 106/01
        both are taken in after a gap if the other is first:
            0@0 1@0 | 1@100; 0@100: reset 100/01; 0@106; 1@106: 106/01
        """,
    ),
    (
        {"radars": 1},
        """
        one radar is not waited for:
            | 0@0: 0/0; 0@6: 6/0
        """,
    ),
    (
        {"radars": 3},
        """
        a radar hardly ahead of two others takes no report from the third:
            1@0 2@0 0@0.3 1@6 2@6 0@6.3 | 1@12: 6.3/0; 0@12.3; 2@12: 12/12; 2@18: 12.3/0
        a radar that does not come is not waited for beyond the next stamp:
            1@0 2@0 0@0.3 1@6 2@6 0@6.3 | 1@12: 6.3/0; 0@12.3; 1@18: 12/1 12.3/0; 2@18
        a radar further ahead is a scan of its own:
            1@0 2@0 0@2 1@6 2@6 0@8 | 1@12: 8/0; 0@14: 12/1; 2@12: late
        """,
    ),
    (
        {"radars": 1, "reorder_s": 6.0},
        """
        one radar is not waited for by time:
            | 0@0: 0/0; 0@6: 6/0
        """,
    ),
    (
        {"reorder_s": 6.0},
        """
        by time every radar must have reported as late a stamp:
            | 0@1; 0@2; 0@3; 1@1.5: 1/0 1.5/1; 1@2.5: 2/0 2.5/1; 1@3.5: 3/0; 0@5: 3.5/1
        by time a stamp is one scan:
            | 0@0; 1@0: 0/01
        """,
    ),
    (
        {"covered_s": {0: 4.0}},
        """
        a turning radar's report is waited for, since its detections are of a time before it:
            | 0@1; 1@2: 1/0; 1@3; 1@4; 0@2.5: 2/1 2.5/0
        a turning radar that is silent is not waited for:
            0@1 1@2 1@8 | 1@12: 2/1; 1@14: 8/1 12/1 14/1; 1@15: 15/1
        """,
    ),
    (
        {"reorder_s": 5.0},
        """
        by time a radar that never came is not waited for:
            | 0@0; 0@2; 0@4; 0@6: 0/0; 0@8: 2/0; 0@12: 4/0 6/0 8/0 12/0; 0@13: 13/0
        by time what is older than the wait is closed:
            | 0@0; 0@5; 0@5.1: 0/0; 1@4: 4/1
        by time a radar that was silent for two waits is not waited for:
            0@0 1@0 0@4 0@8 | 0@9; 0@10: 4/0 8/0 9/0 10/0; 0@11: 11/0
        by time a radar that returns is waited for again:
            0@0 1@0 0@5 0@10 0@15 0@19 | 1@20; 0@21: 20/1; 1@22: 21/0
        """,
    ),
]
REVOLUTIONS = 6
NONE = Detections(np.zeros((0, 2)), None, np.zeros(0))
# The sector in which the second target is, in the last revolution and the one before.
PASSED = 8
GIVEN = {
    "lag_s": 4.0,
    "radar.clutter_rate": 48.0,
    "estimates_period_s": 3.9,
}


def report(tag=0.0):
    """Return a report with a detection of its own."""
    return Detections(np.array([[float(tag), 0.0]]), None)


def feed(grouper, *reports):
    """Return the events of (radar, second) reports, flattened, resets and rejections included."""
    events = []
    for radar, second in reports:
        found = grouper.add(radar, START + round(second * S), report(second))
        events += [found] if isinstance(found, Rejection) else found
    return events


def shape(events):
    """Return what happened: scans as (second, radars that reported), others as themselves."""
    return [
        (
            (event.stamp_ns - START) / S,
            tuple(i for i, d in enumerate(event.detections) if d is not None),
        )
        if isinstance(event, Scan)
        else (Reset if isinstance(event, Reset) else event)
        for event in events
    ]


def grouper(radars=2, **options):
    return ScanGrouper(radars, reset_threshold_s=10.0, **options)


def played(group, text):
    """Feed the reports of a text, each radar@second, and return it with what follows from each.

    Behind a colon there are the scans as second/radars, resets and rejections.
    """
    steps = []
    for step in text.split(";"):
        report = step.partition(":")[0].strip()
        radar, second = report.split("@")
        steps.append(" ".join([f"{report}:", *map(word, feed(group, (int(radar), float(second))))]))
    return "; ".join(step.rstrip(":") for step in steps)


def word(event):
    if isinstance(event, Scan):
        ((second, radars),) = shape([event])
        return f"{second:g}/{''.join(map(str, radars))}"
    return "reset" if isinstance(event, Reset) else event.name.lower()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        pytest.param(options, text, id=name)
        for options, texts in STREAMS
        for name, text in re.findall(r"^ +(.*):\n +(.*\|.*)$", texts, re.MULTILINE)
    ],
)
def test_add_closes_resets_and_rejects_where_it_should(options, text):
    group, (before, steps) = grouper(**options), text.split("|")
    for report in before.split():
        played(group, report)
    assert played(group, steps) == steps.strip()


def test_add_keeps_reports_and_the_first_of_duplicates():
    group = grouper()
    group.add(1, START, report(11.0))
    (scan,) = group.add(0, START, report(10.0))
    assert [d.measurement[0, 0] for d in scan.detections] == [10.0, 11.0]
    group = grouper()
    group.add(0, START, report(1.0))
    group.add(0, START, report(2.0))
    (scan,) = group.add(1, START, report(3.0))
    assert scan.detections[0].measurement[0, 0] == 1.0


@pytest.mark.parametrize(("first_s", "second_s", "way"), [(106, 0, "back"), (0, 3600, "ahead")])
def test_add_reports_how_far_the_stamps_jumped(first_s, second_s, way):
    group = grouper(1, max_gap_s=30.0)
    feed(group, (0, first_s))
    found, scan = group.add(0, START + second_s * S, report())
    assert found == Reset(second_s - first_s)
    assert found.ahead is (way == "ahead")
    assert str(found) == f"stamps jumped {way} by {abs(second_s - first_s):.1f} s"
    assert scan.stamp_ns == START + second_s * S


@pytest.mark.parametrize(("gap_s", "reset"), [(30.0, False), (30.001, True)])
def test_add_resets_behind_a_gap_above_the_limit(gap_s, reset):
    group = grouper(max_gap_s=30.0)
    feed(group, (0, 0), (1, 0))
    found = [*feed(group, (0, gap_s)), *feed(group, (1, gap_s))]
    assert shape(found) == [*([Reset] if reset else []), (gap_s, (0, 1))]


def test_add_takes_a_gap_for_none_while_one_radar_goes_on():
    group = grouper(max_gap_s=30.0)
    events = feed(group, (0, 0), (1, 0), *((0, 6 * k) for k in range(1, 10)), (1, 60), (0, 60))
    assert Reset not in shape(events)
    assert shape(events)[-1] == (60, (0, 1))


def test_reset_forgets_the_stamp_that_a_gap_begins_with():
    group = grouper(1, max_gap_s=30.0)
    feed(group, (0, 0))
    group.reset()
    assert shape(feed(group, (0, 100))) == [(100, (0,))]


def test_close_all_closes_what_waits_and_resets_behind_a_gap():
    group = grouper(max_gap_s=30.0)
    feed(group, (0, 0), (1, 0), (0, 100))
    assert shape(group.close_all()) == [Reset, (100, (0,))]
    group = grouper()
    feed(group, (0, 0))
    assert shape(group.close_all()) == [(0, (0,))]
    assert not group.waiting
    assert group.close_all() == []
    assert shape(feed(group, (1, 0))) == [Rejection.LATE]


@pytest.mark.parametrize(("back_s", "reset"), [(10.0, False), (10.001, True)])
def test_add_resets_only_beyond_the_threshold(back_s, reset):
    group = grouper()
    feed(group, (0, 100), (1, 100))
    events = shape(feed(group, (0, 100 - back_s)))
    assert events == ([Reset] if reset else [Rejection.LATE])


@st.composite
def in_order_streams(draw):
    """Return reports in the order of their stamps; who reports a stamp, and first, is free."""
    radars = draw(st.integers(1, 3))
    steps = draw(st.lists(st.integers(1, 5 * S), min_size=1, max_size=25))
    stream, stamp_ns = [], START
    for step in steps:
        stamp_ns += step
        stream += [
            (radar, stamp_ns)
            for radar in draw(
                st.lists(st.integers(0, radars - 1), min_size=1, max_size=radars, unique=True)
            )
        ]
    return radars, stream


@settings(deadline=None, max_examples=150)
@given(case=in_order_streams())
def test_add_loses_nothing_of_an_in_order_stream_but_what_was_closed_without_it(case):
    radars, stream = case
    group = ScanGrouper(radars, reset_threshold_s=10.0)
    scans, late = [], []
    for radar, stamp_ns in stream:
        found = group.add(radar, stamp_ns, report())
        if isinstance(found, Rejection):
            late.append((found, radar, stamp_ns))
        else:
            scans += found
    scans += group.close_all()
    assert all(isinstance(scan, Scan) for scan in scans)
    stamps = [scan.stamp_ns for scan in scans]
    assert stamps == sorted(set(stamps)) == sorted({stamp_ns for _, stamp_ns in stream})
    kept = [
        (radar, scan.stamp_ns)
        for scan in scans
        for radar, detections in enumerate(scan.detections)
        if detections is not None
    ]
    rejected = [(radar, stamp_ns) for _, radar, stamp_ns in late]
    assert sorted(kept + rejected) == sorted(stream)
    # Only a radar that had been silent for two scans can come too late for its own stamp.
    reported = set(stream)
    for kind, radar, stamp_ns in late:
        assert kind is Rejection.LATE
        before = stamps[: stamps.index(stamp_ns)][-2:]
        misses = [(radar, earlier) not in reported for earlier in before]
        assert misses == [True, True]


def waiting(radars=2, seconds=6.0):
    """Return a grouper that holds scans back for radars that are behind."""
    return grouper(radars, reorder_s=seconds)


@settings(deadline=None, max_examples=100)
@given(
    periods=st.lists(st.floats(1.0, 6.0), min_size=1, max_size=3),
    offsets=st.lists(st.floats(0.0, 6.0), min_size=3, max_size=3),
    slices=st.integers(1, 8),
)
def test_add_by_time_loses_nothing_of_whole_revolutions_that_are_cut(periods, offsets, slices):
    arrivals = []
    for radar, (period, offset) in enumerate(zip(periods, offsets, strict=False)):
        for revolution in range(8):
            end = offset + period * (revolution + 1)
            arrivals += [(end, radar, [end - period * k / slices for k in range(slices)][::-1])]
    group = waiting(len(periods), 2.0 * max(periods) + 6.0)
    stream = [(radar, second) for _, radar, cut in sorted(arrivals) for second in cut]
    events = feed(group, *stream) + group.close_all()
    assert all(isinstance(event, Scan) for event in events)
    stamps = [event.stamp_ns for event in events]
    assert stamps == sorted(set(stamps))
    assert sum(d is not None for event in events for d in event.detections) == len(stream)


@pytest.mark.parametrize("compass", [False, True])
@pytest.mark.parametrize("sectors", [1, 2, 3, 16, 32])
def test_sectors_share_the_revolution_and_are_found_again(sectors, compass):
    azimuth = np.random.default_rng(0).uniform(-np.pi, np.pi, 500)
    seen = sum(
        sector_probability(azimuth, coverage_of(k, sectors, compass)) for k in range(sectors)
    )
    np.testing.assert_array_equal(seen, 1.0)
    found = [sector_of(coverage_of(k, sectors, compass), sectors, compass) for k in range(sectors)]
    assert found == list(range(sectors))


def test_sectors_are_counted_as_azimuths_are():
    east, north_east = np.radians([1.0]), np.radians([89.0])
    assert sector_probability(east, coverage_of(0, 4, compass=False)) == 1.0
    # Clockwise from north, the first quarter revolution ends in the east.
    assert sector_probability(north_east, coverage_of(0, 4, compass=True)) == 1.0
    assert sector_probability(-east, coverage_of(1, 4, compass=True)) == 1.0


def test_is_sector_believes_a_number_but_for_most_detections_elsewhere():
    sector = coverage_of(0, 16, compass=False)
    assert is_sector(np.array([0.1, 0.2, 2.0]), sector)
    assert not is_sector(np.array([0.1, 2.2, 2.0]), sector)
    assert is_sector(np.array([2.2, 2.0]), sector)


def found_of(reports, numbered):
    """Return the last filtered estimates, and what was noticed."""
    pipeline = new_pipeline(sweep.configuration(GIVEN))
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


@pytest.mark.parametrize("numbered", [True, False])
def test_a_lost_sector_is_no_miss_and_an_empty_one_is(numbered):
    reports = sweep.sector_reports(REVOLUTIONS, timed=True)
    begin = (REVOLUTIONS - 2) * sweep.SECTORS
    passed = [
        begin + revolution * sweep.SECTORS + PASSED + k for revolution in (0, 1) for k in (-1, 0)
    ]
    empty = [
        (*report[:2], NONE, report[3]) if index in passed else report
        for index, report in enumerate(reports)
    ]
    lost = [report for index, report in enumerate(reports) if index not in passed]

    (whole, _), (without, noticed), (missed, counted) = (
        found_of(sent, numbered) for sent in (reports, lost, empty)
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


def test_slow_radar_beside_a_fast_sensor_with_equal_stamps_loses_no_more_than_its_first_reports():
    grouper, late, scans = ScanGrouper(2, 3.0), 0, 0
    for tick in range(600):
        # The fast sensor's cloud of each stamp comes first.
        for sensor in (0, 1) if tick % 10 == 3 else (0,):
            found = grouper.add(sensor, START + tick * S // 10, report(tick))
            late += found is Rejection.LATE
            scans += 0 if isinstance(found, Rejection) else len(found)
    assert late <= 2
    assert scans + len(grouper.close_all()) == 600
