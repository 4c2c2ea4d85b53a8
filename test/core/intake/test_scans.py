import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phd_jdtc_ros.core.intake.scans import Rejection, Reset, ScanGrouper
from phd_jdtc_ros.core.types import Detections, Scan

S = 1_000_000_000
START = 1_700_000_000 * S


def report(tag=0.0):
    """Return a report that can be told from others."""
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


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_add_makes_one_scan_of_a_stamp_in_any_order(order):
    group = grouper(3)
    first = feed(group, *((radar, 0) for radar in order[:-1]))
    assert first == []
    assert group.waiting
    assert shape(feed(group, (order[-1], 0))) == [(0, (0, 1, 2))]
    assert not group.waiting


def test_add_keeps_the_reports_with_their_radar():
    group = grouper()
    group.add(1, START, report(11.0))
    (scan,) = group.add(0, START, report(10.0))
    assert [d.measurement[0, 0] for d in scan.detections] == [10.0, 11.0]


def test_add_closes_a_scan_when_a_later_stamp_comes():
    group = grouper()
    assert feed(group, (0, 0)) == []
    assert shape(feed(group, (0, 6))) == [(0, (0,))]
    assert shape(feed(group, (1, 6))) == [(6, (0, 1))]


def test_add_stops_waiting_for_a_radar_that_missed_two_scans():
    group = grouper()
    feed(group, (0, 0), (1, 0))
    assert feed(group, (0, 6)) == []
    assert shape(feed(group, (0, 12))) == [(6, (0,))]
    # Two misses once 12 is closed, which the report of 18 does; then 18 needs no waiting.
    assert shape(feed(group, (0, 18))) == [(12, (0,)), (18, (0,))]
    assert shape(feed(group, (0, 24))) == [(24, (0,))]


def test_add_waits_again_for_a_radar_that_returns():
    group = grouper()
    feed(group, (0, 0), (1, 0), (0, 6), (0, 12), (0, 18))
    assert feed(group, (1, 24)) == []  # radar 0 is live
    assert shape(feed(group, (0, 24))) == [(24, (0, 1))]
    assert feed(group, (0, 30)) == []  # waits for radar 1 again
    assert shape(feed(group, (1, 30))) == [(30, (0, 1))]


def test_add_waits_again_for_a_radar_whose_first_report_back_is_late():
    group = grouper()
    feed(group, (0, 0), (1, 0), (0, 6), (0, 12), (0, 18))
    assert shape(feed(group, (1, 18))) == [Rejection.LATE]
    assert feed(group, (0, 24)) == []
    assert shape(feed(group, (1, 24))) == [(24, (0, 1))]


def test_add_rejects_a_duplicate_before_and_after_its_scan_closed():
    group = grouper()
    assert shape(feed(group, (0, 0), (0, 0))) == [Rejection.DUPLICATE]
    assert shape(feed(group, (1, 0), (1, 0), (0, 0))) == [
        (0, (0, 1)),
        Rejection.DUPLICATE,
        Rejection.DUPLICATE,
    ]


def test_add_keeps_the_first_of_duplicates():
    group = grouper()
    group.add(0, START, report(1.0))
    group.add(0, START, report(2.0))
    (scan,) = group.add(1, START, report(3.0))
    assert scan.detections[0].measurement[0, 0] == 1.0


def test_add_rejects_a_late_report():
    group = grouper()
    events = feed(group, (0, 0), (0, 6), (1, 0), (1, 6))
    assert shape(events) == [(0, (0,)), Rejection.LATE, (6, (0, 1))]


@pytest.mark.parametrize("pending", [False, True])
def test_add_resets_once_when_the_stamps_jump_back(pending):
    group = grouper()
    feed(group, (0, 100), (1, 100))
    old = [(106, (0,))] if pending else []
    if pending:
        feed(group, (0, 106))
    events = feed(group, (0, 0), (1, 0), (0, 6), (1, 6))
    assert shape(events) == [*old, Reset, (0, (0, 1)), (6, (0, 1))]


@pytest.mark.parametrize("complete", [False, True])
def test_add_takes_what_the_jump_overtook_for_late_and_not_for_a_jump_ahead(complete):
    # Topics are not ordered among each other: radar 1 ends its pass after radar 0 began the next.
    group = grouper(max_gap_s=60.0)
    feed(group, (0, 100), (1, 100), (0, 106), *([(1, 106)] if complete else []))
    rest = [] if complete else [(1, 106)]
    events = feed(group, (0, 0), *rest, (1, 0), (0, 6), (1, 6))
    old = [] if complete else [(106, (0,))]
    late = [] if complete else [Rejection.LATE]
    assert shape(events) == [*old, Reset, *late, (0, (0, 1)), (6, (0, 1))]


def test_add_goes_with_a_radar_whose_stamps_go_on_behind_the_jump():
    group = grouper(max_gap_s=60.0)
    feed(group, (0, 100), (1, 100), (0, 106))
    events = feed(group, (0, 0), (1, 106), (1, 112), (0, 118), (1, 118))
    assert shape(events) == [
        (106, (0,)),
        Reset,
        Rejection.LATE,
        (0, (0,)),
        Reset,
        (112, (1,)),
        (118, (0, 1)),
    ]


def test_add_says_how_far_the_stamps_jumped_back():
    group = grouper()
    feed(group, (0, 100), (1, 100), (0, 106))
    (_, found) = group.add(1, START, report())
    assert found == Reset(-106.0)
    assert not found.ahead
    assert str(found) == "stamps jumped back by 106.0 s"


@pytest.mark.parametrize(("gap_s", "reset"), [(30.0, False), (30.001, True)])
def test_add_resets_behind_a_gap_above_the_limit(gap_s, reset):
    group = grouper(max_gap_s=30.0)
    feed(group, (0, 0), (1, 0))
    found = [*feed(group, (0, gap_s)), *feed(group, (1, gap_s))]
    assert shape(found) == [*([Reset] if reset else []), (gap_s, (0, 1))]


def test_add_says_how_far_the_stamps_jumped_ahead():
    group = grouper(1, max_gap_s=30.0)
    feed(group, (0, 0))
    found, scan = group.add(0, START + 3600 * S, report())
    assert found == Reset(3600.0)
    assert found.ahead
    assert str(found) == "stamps jumped ahead by 3600.0 s"
    assert scan.stamp_ns == START + 3600 * S


@pytest.mark.parametrize("first", [0, 1])
def test_add_takes_both_radars_in_after_a_gap_whichever_is_first(first):
    group = grouper(max_gap_s=30.0)
    feed(group, (0, 0), (1, 0))
    events = feed(group, (first, 100), (1 - first, 100), (0, 106), (1, 106))
    assert shape(events) == [Reset, (100, (0, 1)), (106, (0, 1))]


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


def test_close_all_resets_behind_a_gap_too():
    group = grouper(max_gap_s=30.0)
    feed(group, (0, 0), (1, 0), (0, 100))
    assert shape(group.close_all()) == [Reset, (100, (0,))]


@pytest.mark.parametrize(("back_s", "reset"), [(10.0, False), (10.001, True)])
def test_add_resets_only_beyond_the_threshold(back_s, reset):
    group = grouper()
    feed(group, (0, 100), (1, 100))
    events = shape(feed(group, (0, 100 - back_s)))
    assert events == ([Reset] if reset else [Rejection.LATE])


def test_add_counts_every_radar_as_live_after_a_reset():
    group = grouper()
    feed(group, (0, 100), (1, 100), (0, 106), (0, 112), (0, 118))
    assert shape(feed(group, (0, 0))) == [Reset]
    assert shape(feed(group, (1, 0))) == [(0, (0, 1))]


def test_add_makes_a_scan_of_every_stamp_of_unsynchronised_radars():
    group = grouper()
    stamps = [(0, 0.0), (1, 2.5), (0, 6.0), (1, 8.5), (0, 12.0), (1, 14.5)]
    events = feed(group, *stamps) + group.close_all()
    assert shape(events) == [(second, (radar,)) for radar, second in stamps]


def test_add_closes_at_once_with_one_radar():
    assert shape(feed(grouper(1), (0, 0), (0, 6))) == [(0, (0,)), (6, (0,))]


def test_close_all_closes_what_waits():
    group = grouper()
    feed(group, (0, 0))
    assert shape(group.close_all()) == [(0, (0,))]
    assert not group.waiting
    assert group.close_all() == []
    assert shape(feed(group, (1, 0))) == [Rejection.LATE]


@pytest.mark.parametrize("slow_first", list(itertools.product([False, True], repeat=3)))
def test_add_waits_for_a_radar_of_half_the_rate_whichever_arrives_first(slow_first):
    # Radar 1 reports every second stamp, so it never misses two in a row.
    stream = []
    for pair, first in enumerate(slow_first):
        both = [(1, 12 * pair), (0, 12 * pair)]
        stream += (both if first else both[::-1]) + [(0, 12 * pair + 6)]
    group = grouper()
    events = feed(group, *stream) + group.close_all()
    assert shape(events) == [
        scan for pair in range(3) for scan in ((12 * pair, (0, 1)), (12 * pair + 6, (0,)))
    ]


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


@settings(deadline=None, max_examples=60)
@given(
    radars=st.integers(1, 4),
    scans=st.integers(1, 15),
    seed=st.integers(0, 10**6),
)
def test_add_makes_whole_scans_of_radars_that_all_report(radars, scans, seed):
    rng = np.random.default_rng(seed)
    group = ScanGrouper(radars, reset_threshold_s=10.0)
    events = feed(
        group, *((int(radar), 6 * k) for k in range(scans) for radar in rng.permutation(radars))
    )
    assert shape(events) == [(6 * k, tuple(range(radars))) for k in range(scans)]
    assert not group.waiting


def test_add_drops_swapped_scans():
    swapped = [(0, 0), (0, 12), (0, 6), (0, 24), (0, 18), (0, 30)]
    assert shape(feed(grouper(1), *swapped)).count(Rejection.LATE) == 2


def test_add_loses_the_first_report_back_of_a_silent_radar():
    group = grouper()
    feed(group, (0, 0), (1, 0), *((0, 6 * k) for k in range(1, 9)))
    # The scan was closed at once by the radar that is there.
    found = shape(feed(group, (1, 48), (0, 54), (1, 54), (0, 60), (1, 60)))
    assert Rejection.LATE in found
    assert (54, (0, 1)) in found


def waiting(radars=2, seconds=6.0):
    """Return a grouper that holds scans back for radars that are behind."""
    return grouper(radars, reorder_s=seconds)


def test_add_by_time_waits_until_every_radar_has_reported_as_late_a_stamp():
    group = waiting()
    # Two radars that report turns of four slices, one turn after the other.
    assert feed(group, (0, 1), (0, 2), (0, 3), (0, 4)) == []
    assert shape(feed(group, (1, 1.5))) == [(1, (0,)), (1.5, (1,))]
    found = shape(feed(group, (1, 2.5), (1, 3.5), (1, 4.5)))
    assert found == [(2, (0,)), (2.5, (1,)), (3, (0,)), (3.5, (1,)), (4, (0,))]
    assert group.waiting
    assert shape(feed(group, (0, 5))) == [(4.5, (1,))]


def test_add_by_time_makes_one_scan_of_a_stamp():
    group = waiting()
    assert feed(group, (0, 0)) == []
    assert shape(feed(group, (1, 0))) == [(0, (0, 1))]


def test_add_by_time_closes_at_once_with_one_radar():
    assert shape(feed(waiting(1), (0, 0), (0, 6))) == [(0, (0,)), (6, (0,))]


def test_add_by_time_closes_what_is_older_than_the_wait():
    group = waiting(seconds=5.0)
    assert feed(group, (0, 0), (0, 5)) == []
    assert shape(feed(group, (0, 5.1))) == [(0, (0,))]
    assert shape(feed(group, (1, 4))) == [(4, (1,))]


def test_add_by_time_stops_waiting_for_a_radar_that_was_silent_for_two_waits():
    group = waiting(seconds=5.0)
    feed(group, (0, 0), (1, 0), *((0, second) for second in range(1, 10)))
    assert group.waiting
    assert shape(feed(group, (0, 10)))[-1] == (10, (0,))
    assert not group.waiting
    assert shape(feed(group, (0, 11))) == [(11, (0,))]


def test_add_by_time_does_not_wait_for_a_radar_that_never_came():
    group = waiting(seconds=5.0)
    found = feed(group, *((0, second) for second in range(12)))
    assert shape(found) == [(second, (0,)) for second in range(12)]


def test_add_by_time_waits_again_for_a_radar_that_returns():
    group = waiting(seconds=5.0)
    feed(group, (0, 0), (1, 0), *((0, second) for second in range(1, 20)))
    assert shape(feed(group, (1, 20), (0, 21))) == [(20, (1,))]
    assert shape(feed(group, (1, 22))) == [(21, (0,))]


@settings(deadline=None, max_examples=100)
@given(
    periods=st.lists(st.floats(1.0, 6.0), min_size=1, max_size=3),
    offsets=st.lists(st.floats(0.0, 6.0), min_size=3, max_size=3),
    slices=st.integers(1, 8),
)
def test_add_by_time_loses_nothing_of_whole_turns_that_are_cut(periods, offsets, slices):
    arrivals = []
    for radar, (period, offset) in enumerate(zip(periods, offsets, strict=False)):
        for turn in range(8):
            end = offset + period * (turn + 1)
            arrivals += [(end, radar, [end - period * k / slices for k in range(slices)][::-1])]
    group = waiting(len(periods), 2.0 * max(periods) + 6.0)
    stream = [(radar, second) for _, radar, cut in sorted(arrivals) for second in cut]
    events = feed(group, *stream) + group.close_all()
    assert all(isinstance(event, Scan) for event in events)
    stamps = [event.stamp_ns for event in events]
    assert stamps == sorted(set(stamps))
    assert sum(d is not None for event in events for d in event.detections) == len(stream)
