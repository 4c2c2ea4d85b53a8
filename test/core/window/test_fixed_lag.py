"""The window, the schedule and the snapshots around an engine whose rows are marks."""

import json

import numpy as np
import pytest
from marks import MODEL, MarkEngine, MarkFilter, rule
from sweep import configuration

from phd_jdtc_ros.core.engine import Lag
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.snapshot import Snapshot
from phd_jdtc_ros.core.tracks.common_stamp import Schedule
from phd_jdtc_ros.core.types import Coverage, Detections, Scan

SECOND = 1_000_000_000
QUARTER = 0.5 * np.pi


def engine(lag=4, threshold=0.5):
    return MarkEngine(MarkFilter(MODEL), Lag(lag), Schedule(0), rule(threshold))


def sector(index):
    """Return the scan of a quarter of a turn, the first one about the east."""
    coverage = Coverage((index % 4 - 0.5) * QUARTER, QUARTER)
    return Scan((index + 1) * SECOND, (Detections(np.zeros((0, 2)), None, coverage=coverage),))


def whole(index):
    """Return the scan of a whole turn."""
    return Scan((index + 1) * SECOND, (Detections(np.zeros((0, 2)), None),))


def run(of, first, last, scan=sector):
    steps = [of.step(scan(index)) for index in range(first, last)]
    return [e for step in steps for e in step.filtered], [e for s in steps for e in s.smoothed]


def stored_and_read(snapshot):
    facts = json.loads(json.dumps(snapshot.facts))
    return Snapshot(snapshot.stamp_ns, dict(snapshot.arrays), facts)


def test_filtered_estimates_are_of_the_last_scan_that_touched_each_target():
    filtered, _ = run(engine(), 0, 9)
    by_track = dict(zip(filtered[-1].track_id, filtered[-1].weight, strict=True))
    # Scan 0 began all four; the antenna then came by the others, one after the other.
    # What is predicted from an earlier scan may have died since.
    assert sorted(by_track.values()) == pytest.approx([6.0, 7.0, 8.0, 9.0], rel=1e-2)
    assert {len(estimates) for estimates in filtered} == {4}


def test_smoothed_estimates_have_heard_of_the_scans_within_the_lag():
    _, smoothed = run(engine(lag=4), 0, 12)
    assert [estimates.stamp_ns for estimates in smoothed] == [n * SECOND for n in range(1, 9)]
    # Each of the four later scans passes another target, and none is known of farther ahead.
    assert sorted(smoothed[0].weight) == [2.0, 3.0, 4.0, 5.0]
    for index, estimates in enumerate(smoothed):
        assert len(estimates) == 4
        assert estimates.weight.max() <= index + 5.0


def test_filtered_estimates_are_of_targets_above_the_threshold():
    filtered, _ = run(engine(threshold=7.5), 0, 9)
    # Of 6, 7, 8 and 9, when their scans touched them.
    assert [len(estimates) for estimates in filtered] == [0, 0, 0, 0, 0, 0, 0, 1, 2]


@pytest.mark.parametrize(
    ("scan", "threshold", "found"), [(sector, 4.5, [1, 2, 3, 4]), (whole, 5.5, [0, 4, 4, 4])]
)
def test_smoothed_estimates_are_of_targets_above_the_threshold(scan, threshold, found):
    # The first ones are of 2, 3, 4 and 5 by sectors, and all of 5 by turns; then of one more.
    _, smoothed = run(engine(threshold=threshold), 0, 8, scan)
    assert [len(estimates) for estimates in smoothed] == found


def test_changed_threshold_is_that_of_the_next_estimates():
    of = engine()
    assert {len(estimates) for estimates in run(of, 0, 9)[0]} == {4}
    of.retune(MODEL, rule(10.5))
    filtered, smoothed = run(of, 9, 11)
    assert len(filtered[-1]) == 4 - 1  # the scan before the last one touched a target of 10
    assert [len(estimates) for estimates in smoothed] == [0, 1]


def test_window_forgets_what_no_stamp_needs():
    of = engine(lag=4)
    run(of, 0, 40)
    assert len(of._window) <= 4 + 4 + 1


def test_restored_engine_goes_on_and_an_interrupted_one_uses_no_number_again():
    first, second = engine(), engine()
    run(first, 0, 7)
    second.restore(stored_and_read(first.snapshot()))
    for one, other in zip(run(first, 7, 12), run(second, 7, 12), strict=True):
        for ours, theirs in zip(one, other, strict=True):
            np.testing.assert_array_equal(ours.weight, theirs.weight)
            np.testing.assert_array_equal(ours.track_id, theirs.track_id)
    assert [len(e) for e in first.flush()] == [len(e) for e in second.interrupt()] == [4] * 4
    (after,) = second.step(sector(12)).filtered
    assert sorted(after.track_id) == [5, 6, 7, 8]


def of_smoother(**facts):
    return lambda held: held.facts["smoother"].update(facts)


def of_tracks(**facts):
    return lambda held: held.facts["smoother"]["tracks"].update(facts)


def at_index(index, **facts):
    return lambda held: held.facts[f"stored.{index}"].update(facts)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (of_smoother(stamps_ns=[2, 1]), "ValueError: stamps_ns: must increase"),
        (of_smoother(stamps_ns=[2, 2]), "ValueError: stamps_ns: must increase"),
        (of_smoother(stamps_ns=[1.5]), "ValueError: stamps_ns: 1.5 given"),
        (of_smoother(stamps_ns=[5, 7 * SECOND + 1]), "end at 7000000001, after 7000000000$"),
        (of_smoother(entries=-1), "ValueError: entries: -1 given"),
        (of_smoother(entries=99), "KeyError: 'stored.7'"),
        (of_tracks(count=-1), "tracks.count: -1 given"),
        (of_tracks(number=[[-1, 1]]), "ValueError: label: -1 given"),
        (of_tracks(number=[[2**63, 1]]), f"ValueError: label: {2**63} given"),
        (of_tracks(number=[[2, 5]]), r"ValueError: track: 5 given, must be .* \[1, 4\]"),
        (lambda held: held.facts["filter"].update(current_ns=[5]), "none of the stored sets"),
        (at_index(1, sizes=[3]), "rows, expected"),
        (lambda held: held.arrays.pop(f"filtered.{7 * SECOND}.weight"), "weight: missing"),
    ],
)
def test_restore_says_what_is_wrong_and_leaves_a_new_engine(change, named):
    of, fresh = engine(), engine()
    run(of, 0, 7)
    held = stored_and_read(of.snapshot())
    change(held)
    with pytest.raises(ValueError, match=f"^snapshot: .*{named}"):
        of.restore(held)
    assert run(of, 0, 3)[0][-1].weight.tolist() == run(fresh, 0, 3)[0][-1].weight.tolist()


@pytest.mark.parametrize("later", [0, -SECOND])
def test_restore_refuses_sets_that_do_not_increase(later):
    of = engine()
    run(of, 0, 2, whole)
    held = stored_and_read(of.snapshot())
    held.facts["stored.1"].update(stamp_ns=SECOND + later, sources_ns=[], sizes=[])
    with pytest.raises(ValueError, match=r"stored\.1\.stamp_ns: must increase$"):
        of.restore(held)


def test_restore_refuses_stamps_of_an_engine_that_has_had_no_scan():
    of = engine()
    held = stored_and_read(of.snapshot())
    held.facts["smoother"]["stamps_ns"] = [1]
    with pytest.raises(ValueError, match=r"stamps_ns: end at 1, after None$"):
        of.restore(held)


def test_engine_that_has_had_no_scan_is_restored():
    of, fresh = engine(), engine()
    of.restore(stored_and_read(engine().snapshot()))
    assert run(of, 0, 3)[0][-1].weight.tolist() == run(fresh, 0, 3)[0][-1].weight.tolist()


def test_scans_from_the_start_of_time_are_restored():
    of, other = engine(), engine()
    of.step(sector(-1))
    other.restore(stored_and_read(of.snapshot()))
    for one in (of, other):
        one.step(sector(0))
    assert [e.stamp_ns for e in of.flush()] == [e.stamp_ns for e in other.flush()] == [0, SECOND]


def test_stamp_before_all_sets_has_no_targets():
    of = engine()
    run(of, 0, 3)
    held = stored_and_read(of.snapshot())
    held.facts["smoother"]["stamps_ns"] = [5, SECOND, 2 * SECOND]
    of.restore(held)
    early, *others = of.flush()
    assert (early.stamp_ns, early.lag, len(early)) == (5, 2, 0)
    assert early.class_probability.shape == (0, len(MODEL.modes.classes))
    assert [len(estimates) for estimates in others] == [4, 4]


def test_steps_tell_their_parts_and_figures():
    of, parts = engine(lag=2), []
    of.forward.done = parts.append
    assert of.step(sector(0)).figures == {"touched": 0}
    assert of.step(sector(1)).figures == {"touched": 4}  # the set of the first scan
    assert parts == ["extraction"] * 2
    of.step(sector(2))
    assert parts[2:] == ["extraction", "backward", "extraction"]


def test_steps_by_period_tell_the_same_parts():
    parts = []
    of = MarkEngine(MarkFilter(MODEL, done=parts.append), Lag(2), Schedule(SECOND * 3), rule(0.5))
    run(of, 0, 3)
    assert parts == ["extraction"] * 3
    of.step(sector(3))
    assert len(of.flush()) == 1
    assert parts[3:] == ["extraction", "backward", "extraction"]


def test_links_to_sets_that_have_left_are_dropped():
    of = engine(lag=2)
    run(of, 0, 12, whole)
    held = of.snapshot()
    # Of the two last scans, whose estimates are to come, the first one's source has left.
    assert [name for name in sorted(held.facts) if name.startswith("stored.")] == [
        "stored.0",
        "stored.1",
    ]
    assert [name for name in held.arrays if name.endswith(".link")] == ["stored.1.link"]


def test_clutter_raster_is_of_the_radars_that_learn_a_map():
    assert engine().clutter_raster() is None
    of = engine()
    of.retune(configuration({"radar.clutter_map": True}).model, of.rule)
    (radar,), memory = of.forward.model.radars, of.forward.clutter
    report = Detections(np.array([[20e3, 0.5]]), None)
    for _ in range(30):
        memory.learn(memory.informed(Report(radar, report)), np.zeros(1), np.zeros(1))
    drawn = of.clutter_raster()
    row, column = np.unravel_index(drawn.density.argmax(), drawn.density.shape)
    (place,) = radar.to_world(report.measurement)
    corner = drawn.corner + drawn.cell * np.array([column, row])
    assert np.abs(corner + 0.5 * drawn.cell - place).max() < 2.0 * radar.range_std


def test_stamp_that_is_not_later_is_refused():
    of = engine()
    of.step(sector(3))
    with pytest.raises(ValueError, match="not later than"):
        of.step(sector(3))


# --- Scans that come late -------------------------------------------------------------------------


def same(ours, theirs):
    """Check that estimates are the same, tracks included."""
    assert [found.stamp_ns for found in ours] == [found.stamp_ns for found in theirs]
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(one.weight, other.weight)
        np.testing.assert_array_equal(one.track_id, other.track_id)
        np.testing.assert_array_equal(one.state, other.state)


@pytest.mark.parametrize("late", [1, 5, 7])
@pytest.mark.parametrize("period_ns", [0, 700_000_000])
@pytest.mark.parametrize("tuned", [None, 7])
def test_reworked_engine_is_one_that_had_the_late_scan_in_time(late, period_ns, tuned):
    of, timely = (
        MarkEngine(MarkFilter(MODEL), Lag(4), Schedule(period_ns), rule(0.5)) for _ in range(2)
    )
    held, given = {}, ([], [])
    for index in range(9):
        if index == tuned:
            of.retune(MODEL, rule(4.5))
        if index != late:
            held[index] = of.hold()
            assert held[index].stamp_ns == of.forward.stamp_ns
            step = of.step(sector(index))
            given[0].extend(step.filtered)
            given[1].extend(step.smoothed)
    again = [(held[max(index, late + 1)], sector(index)) for index in range(late, 9)]
    found = of.rework(again)

    before, every = [], ([], [])
    for index in range(9):
        if index == (late if tuned == late else tuned):
            timely.retune(MODEL, rule(4.5))
        before.append(timely.hold())
        step = timely.step(sector(index))
        every[0].extend(step.filtered)
        every[1].extend(step.smoothed)
    for ours, theirs, out in zip((found.filtered, found.smoothed), every, given, strict=True):
        last = out[-1].stamp_ns if out else -1
        due = [one for one in theirs if one.stamp_ns > last]
        same(ours, due if period_ns or ours is found.smoothed else [])
    # What it holds before each of these scans, and what it goes on with.
    assert [one.stamp_ns for one in found.held] == [one.stamp_ns for one in before[late:]]
    mine, theirs = of.snapshot(), timely.snapshot()
    assert mine.facts == theirs.facts
    assert mine.arrays.keys() == theirs.arrays.keys()
    for name, array in mine.arrays.items():
        np.testing.assert_array_equal(array, theirs.arrays[name])
    # A second rework starts from what the first one held.
    twice = of.rework(list(zip(found.held, (scan for _, scan in again), strict=True)))
    assert (twice.filtered, twice.smoothed) == ((), ())
    assert of.snapshot().facts == theirs.facts
    for one, other in zip(run(of, 9, 14), run(timely, 9, 14), strict=True):
        same(one, other)
