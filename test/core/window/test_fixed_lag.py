"""The window, the schedule and the snapshots around an engine whose rows are marks."""

import numpy as np
import pytest
from marks import MODEL, MarkEngine, MarkFilter, rule
from runs import assert_same, equal, stepped, stored_and_read
from sweep import configuration

from phd_jdtc_ros.core.engine import Lag
from phd_jdtc_ros.core.sensors.report import Report
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


def stepped_through(of, first, last, scan=sector):
    return stepped(of, map(scan, range(first, last)))


def whole(index):
    """Return the scan of a whole turn."""
    return Scan((index + 1) * SECOND, (Detections(np.zeros((0, 2)), None),))


def test_filtered_estimates_follow_the_threshold():
    filtered, _ = stepped_through(engine(threshold=7.5), 0, 9)
    # These are the estimates of 6, 7, 8 and 9, when their scans swept them.
    assert [len(estimates) for estimates in filtered] == [0, 0, 0, 0, 0, 0, 0, 1, 2]
    of = engine()
    assert {len(estimates) for estimates in stepped_through(of, 0, 9)[0]} == {4}
    of.retune(MODEL, rule(10.5))
    filtered, smoothed = stepped_through(of, 9, 11)
    assert len(filtered[-1]) == 4 - 1  # the scan before the last one swept a target of 10
    assert [len(estimates) for estimates in smoothed] == [0, 1]


@pytest.mark.parametrize(
    ("scan", "threshold", "found"), [(sector, 4.5, [1, 2, 3, 4]), (whole, 5.5, [0, 4, 4, 4])]
)
def test_smoothed_estimates_are_of_targets_above_the_threshold(scan, threshold, found):
    # The first ones are of 2, 3, 4 and 5 by sectors, and all of 5 by turns; then of one more.
    _, smoothed = stepped_through(engine(threshold=threshold), 0, 8, scan)
    assert [len(estimates) for estimates in smoothed] == found


def test_window_forgets_stamps_and_links_that_nothing_needs():
    of = engine(lag=4)
    stepped_through(of, 0, 40)
    assert len(of._window) <= 4 + 4 + 1
    of = engine(lag=2)
    stepped_through(of, 0, 12, whole)
    held = of.snapshot()
    # The last two scans have no estimates yet; the source of the first one has left.
    assert held.names_below("stored") == {"0", "1"}
    assert [name for name in held.arrays if name.endswith(".link")] == ["stored.1.link"]


def test_restored_engine_goes_on_and_an_interrupted_one_uses_no_number_again():
    first, second = engine(), engine()
    stepped_through(first, 0, 7)
    second.restore(stored_and_read(first.snapshot()))
    for one, other in zip(
        stepped_through(first, 7, 12), stepped_through(second, 7, 12), strict=True
    ):
        for ours, theirs in zip(one, other, strict=True):
            np.testing.assert_array_equal(ours.weight, theirs.weight)
            np.testing.assert_array_equal(ours.track_id, theirs.track_id)
    assert [len(e) for e in first.flush()] == [len(e) for e in second.interrupt()] == [4] * 4
    (after,) = second.step(sector(12)).filtered
    assert sorted(after.track_id) == [5, 6, 7, 8]


@pytest.mark.parametrize("end", ["flush", "interrupt"])
def test_engine_uses_no_number_again_whatever_ends_a_run(end):
    of = engine()
    stepped_through(of, 0, 7)
    getattr(of, end)()
    # As after a jump back: the same scans give targets of other numbers.
    (*_, (after, *_)) = stepped_through(of, 0, 7)
    assert sorted(after.track_id) == [5, 6, 7, 8]


def test_interrupted_engine_remembers_aircraft():
    aircraft = {"number": [1], "address": [77], "stamp_ns": [0]}
    aircraft |= {"position": [[1e3, 2e3]], "speed": [90.0]}
    first, second = engine(), engine()
    stepped_through(first, 0, 7)
    snapshot = first.snapshot()
    snapshot.arrays.update({f"aircraft.{name}": np.array(of) for name, of in aircraft.items()})
    second.restore(stored_and_read(snapshot))
    second.interrupt()
    arrays = second.snapshot().arrays
    assert {name: arrays[f"aircraft.{name}"].tolist() for name in aircraft} == aircraft


def put(name, value):
    """Return a change that replaces an array."""
    return lambda stored: stored.arrays.update({name: np.array(value)})


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (put("window.stamps_ns", [2, 1]), "ValueError: window.stamps_ns: must increase"),
        (put("window.stamps_ns", [2, 2]), "ValueError: window.stamps_ns: must increase"),
        (put("window.stamps_ns", [1.5]), "window.stamps_ns: float64 given, expected whole"),
        (
            put("window.stamps_ns", [5, 7 * SECOND + 1]),
            "last stamp is 7000000001, must be at most 7000000000$",
        ),
        (put("window.entries", -1), "ValueError: window.entries: -1 given"),
        (put("window.entries", 99), "ValueError: stored.7.stamp_ns: missing"),
        (put("numbers.last", -1), "numbers.last: -1 given"),
        (put("numbers.label", [-1, 1, 2, 3]), "numbers.label: a number is not finite, or outside"),
        (put("numbers.label", [1]), r"numbers.number: shape \(4,\), expected \(1\)"),
        (put("numbers.number", [2, 5, 1, 3]), "numbers.number: 5 given, must be at most 4"),
        (put("filter.current_ns", [5]), "none of the stored sets"),
        (put("filter.current_ns", [SECOND]), "the last stamp must be 7000000000"),
        (put("stored.1.size", [3]), "rows, expected"),
        (put("stored.6.source_ns", [8 * SECOND]), "stored.6.source_ns: "),
        (put("stored.1.size", [101]), "stored.1.size: 101 rows, at most 100"),
        (put("stored.6.listed", [1]), "stored.6.rows: "),
        (put(f"current.{4 * SECOND}.rows", [99]), "rows: 99 given, must be below"),
        (put(f"current.{4 * SECOND}.rows", [1, 0]), "rows: must increase"),
        (lambda stored: stored.arrays.pop(f"filtered.{7 * SECOND}.weight"), "weight: missing"),
        (
            put(f"filtered.{7 * SECOND}.state", np.ones((1, 6))),
            r"shape \(1, 6\), expected \(T, 5\)",
        ),
        (
            put(f"filtered.{7 * SECOND}.class_probability", np.ones((1, 2))),
            r"shape \(1, 2\), expected \(1, 1\)",
        ),
    ],
)
def test_restore_reports_what_is_wrong_and_leaves_a_new_engine(change, named):
    of, fresh = engine(), engine()
    stepped_through(of, 0, 7)
    held = stored_and_read(of.snapshot())
    change(held)
    with pytest.raises(ValueError, match=f"^snapshot: .*{named}"):
        of.restore(held)
    assert (
        stepped_through(of, 0, 3)[0][-1].weight.tolist()
        == stepped_through(fresh, 0, 3)[0][-1].weight.tolist()
    )


@pytest.mark.parametrize("later", [0, -SECOND])
def test_restore_refuses_sets_that_do_not_increase(later):
    of = engine()
    stepped_through(of, 0, 2, whole)
    held = stored_and_read(of.snapshot())
    put("stored.1.stamp_ns", SECOND + later)(held)
    for part in ("source_ns", "size", "listed", "rows"):
        put(f"stored.1.{part}", np.zeros(0, dtype=np.int64))(held)
    with pytest.raises(ValueError, match=r"stored\.1\.stamp_ns: must increase$"):
        of.restore(held)


def test_engines_without_scans_are_stored_and_restored():
    of = engine()
    held = stored_and_read(of.snapshot())
    put("window.stamps_ns", [1])(held)
    with pytest.raises(ValueError, match=r"stamps_ns: the last stamp is 1, must be at most None$"):
        of.restore(held)
    of, fresh = engine(), engine()
    of.restore(stored_and_read(engine().snapshot()))
    assert (
        stepped_through(of, 0, 3)[0][-1].weight.tolist()
        == stepped_through(fresh, 0, 3)[0][-1].weight.tolist()
    )


def test_stamps_rise_from_the_start_of_time_on():
    of, other = engine(), engine()
    of.step(sector(-1))
    other.restore(stored_and_read(of.snapshot()))
    for one in (of, other):
        one.step(sector(0))
    assert [e.stamp_ns for e in of.flush()] == [e.stamp_ns for e in other.flush()] == [0, SECOND]
    of = engine()
    of.step(sector(3))
    with pytest.raises(ValueError, match="not later than"):
        of.step(sector(3))


def test_stamp_before_all_sets_has_no_targets():
    of = engine()
    stepped_through(of, 0, 3)
    held = stored_and_read(of.snapshot())
    put("window.stamps_ns", [5, SECOND, 2 * SECOND])(held)
    of.restore(held)
    early, *others = of.flush()
    assert (early.stamp_ns, early.lag, len(early)) == (5, 2, 0)
    assert early.class_probability.shape == (0, len(MODEL.modes.classes))
    assert [len(estimates) for estimates in others] == [4, 4]


def test_steps_report_their_parts_and_figures():
    of, parts = engine(lag=2), []
    of.forward.on_stage_end = parts.append
    assert of.step(sector(0)).figures == {"swept": 0}
    assert of.step(sector(1)).figures == {"swept": 4}  # the set of the first scan
    assert parts == ["extraction"] * 2
    of.step(sector(2))
    assert parts[2:] == ["extraction", "backward", "extraction"]


def test_steps_by_period_report_the_same_parts():
    parts = []
    of = MarkEngine(
        MarkFilter(MODEL, on_stage_end=parts.append), Lag(2), Schedule(SECOND * 3), rule(0.5)
    )
    stepped_through(of, 0, 3)
    assert parts == ["extraction"] * 3
    of.step(sector(3))
    assert len(of.flush()) == 1
    assert parts[3:] == ["extraction", "backward", "extraction"]


def test_clutter_raster_is_of_the_radars_that_learn_a_map():
    assert engine().clutter_raster() is None
    of = engine()
    of.retune(configuration({"radar.clutter_map": True}).model, of.rule)
    (radar,), memory = of.forward.model.radars, of.forward.sensors
    report = Detections(np.array([[20e3, 0.5]]), None)
    for _ in range(30):
        memory.learn_clutter(memory.prepare(Report(radar, report)), np.zeros(1), np.zeros(1))
    drawn = of.clutter_raster()
    row, column = np.unravel_index(drawn.density.argmax(), drawn.density.shape)
    (place,) = radar.to_world(report.measurement)
    corner = drawn.corner + drawn.cell * np.array([column, row])
    assert np.abs(corner + 0.5 * drawn.cell - place).max() < 2.0 * radar.range_std


# --- Scans that come late -------------------------------------------------------------------------


@pytest.mark.parametrize("late", [1, 5, 7])
@pytest.mark.parametrize("period_ns", [0, 700_000_000])
@pytest.mark.parametrize("tuned", [None, 7])
def test_reprocessing_gives_the_engine_that_had_the_late_scan_in_time(late, period_ns, tuned):
    of, timely = (
        MarkEngine(MarkFilter(MODEL), Lag(4), Schedule(period_ns), rule(0.5)) for _ in range(2)
    )
    held, given = {}, ([], [])
    for index in range(9):
        if index == tuned:
            of.retune(MODEL, rule(4.5))
        if index != late:
            held[index] = of.save_state()
            assert held[index].stamp_ns == of.forward.stamp_ns
            for part, estimates in zip(given, stepped(of, [sector(index)]), strict=True):
                part.extend(estimates)
    again = [(held[max(index, late + 1)], sector(index)) for index in range(late, 9)]
    found = of.reprocess(again)

    before, every = [], ([], [])
    for index in range(9):
        if index == (late if tuned == late else tuned):
            timely.retune(MODEL, rule(4.5))
        before.append(timely.save_state())
        for part, estimates in zip(every, stepped(timely, [sector(index)]), strict=True):
            part.extend(estimates)
    for ours, theirs, out in zip((found.filtered, found.smoothed), every, given, strict=True):
        last = out[-1].stamp_ns if out else -1
        due = [one for one in theirs if one.stamp_ns > last]
        assert equal(list(ours), due if period_ns or ours is found.smoothed else [])
    # States before each of these scans, and the entries that it goes on with.
    assert [one.stamp_ns for one in found.states] == [one.stamp_ns for one in before[late:]]
    assert_same(of.snapshot(), timely.snapshot())
    # A second reprocessing starts from the states of the first one.
    twice = of.reprocess(list(zip(found.states, (scan for _, scan in again), strict=True)))
    assert (twice.filtered, twice.smoothed) == ((), ())
    assert_same(of.snapshot(), timely.snapshot())
    for one, other in zip(stepped_through(of, 9, 14), stepped_through(timely, 9, 14), strict=True):
        assert equal(one, other)
