"""The window, the schedule and the snapshots, of targets that one sector after the other sweeps."""

import numpy as np
import pytest
from four_places import CONFIG, MODEL, SLICE_NS, SLICES, engine, revolution_of, rule, slice_of
from runs import assert_same, equal, stepped, stored_and_read
from sweep import configuration

from phd_jdtc_ros.core.factors import ClutterMap

# Scans of whole revolutions before those of slices; the second one confirms all targets.
REVOLUTIONS = 3
# Stamp of the last of the scans in snapshots that are changed.
LAST = (REVOLUTIONS + 2) * SLICE_NS
MOST = CONFIG.bounds.most


def scan_of(index):
    return (revolution_of if index < REVOLUTIONS else slice_of)(index)


def stepped_through(of, first, last, scan=scan_of):
    return stepped(of, map(scan, range(first, last)))


def lengths(estimates):
    return [len(each) for each in estimates]


def test_estimates_follow_the_threshold_of_the_rule():
    assert lengths(stepped_through(engine(threshold=0.3), 0, 3)[0]) == [4] * 3
    of = engine(lag=2, threshold=0.5)
    # They are smoothed back to where they have been seen once.
    assert list(map(lengths, stepped_through(of, 0, 5))) == [[0, 4, 4, 4, 4], [4] * 3]
    of.retune(MODEL, rule(1.0 - 1e-14))
    # The last scan sweeps one of the targets; the others are as the scans before left them.
    assert list(map(lengths, stepped_through(of, 5, 7))) == [[4, 3], [0, 0]]


def test_window_forgets_stamps_and_links_that_nothing_needs():
    of = engine(lag=4)
    stepped_through(of, 0, 5 * SLICES)
    assert len(of._window) <= 4 + SLICES + 1
    of = engine(lag=2)
    stepped_through(of, 0, 12, revolution_of)
    held = of.snapshot()
    # The last two scans have no estimates yet; the source of the first one has left.
    assert held.names_below("stored") == {"0", "1"}
    assert {name.partition(".link")[0] for name in held.arrays if ".link" in name} == {"stored.1"}


def test_restored_engine_goes_on_and_an_interrupted_one_uses_no_number_again():
    first, second = engine(lag=4), engine(lag=4)
    stepped_through(first, 0, 7)
    second.restore(stored_and_read(first.snapshot()))
    for one, other in zip(
        stepped_through(first, 7, 12), stepped_through(second, 7, 12), strict=True
    ):
        for ours, theirs in zip(one, other, strict=True):
            np.testing.assert_array_equal(ours.weight, theirs.weight)
            np.testing.assert_array_equal(ours.track_id, theirs.track_id)
    assert lengths(first.flush()) == lengths(second.interrupt()) == [4] * 4
    after, _ = stepped_through(second, 12, 14, revolution_of)
    assert sorted(after[-1].track_id) == [5, 6, 7, 8]


@pytest.mark.parametrize("end", ["flush", "interrupt"])
def test_engine_uses_no_number_again_whatever_ends_a_run(end):
    of = engine()
    stepped_through(of, 0, 7)
    getattr(of, end)()
    # As after a jump back: the same scans give targets of other numbers.
    after, _ = stepped_through(of, 0, 7)
    assert sorted(after[-1].track_id) == [5, 6, 7, 8]


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
        (put("window.stamps_ns", [5, LAST + 1]), f"is {LAST + 1}, must be at most {LAST}$"),
        (put("window.entries", -1), "ValueError: window.entries: -1 given"),
        (put("window.entries", 99), "ValueError: stored.4.stamp_ns: missing"),
        (put("numbers.last", -1), "numbers.last: -1 given"),
        (put("numbers.label", [-1, 1, 2, 3]), "numbers.label: a number is not finite, or outside"),
        (put("numbers.label", [1]), r"numbers.number: shape \(4,\), expected \(1\)"),
        (put("numbers.number", [2, 5, 1, 3]), "numbers.number: 5 given, must be at most 4"),
        (put("filter.current_ns", [5]), "none of the stored sets"),
        (put("filter.current_ns", [LAST - SLICE_NS]), f"the last stamp must be {LAST}"),
        (put("stored.1.size", [3]), "rows, expected"),
        (put("stored.3.source_ns", [LAST, LAST]), "stored.3.source_ns: "),
        (put("stored.1.size", [MOST + 1]), f"stored.1.size: {MOST + 1} rows, at most {MOST}"),
        (put("stored.3.listed", [0, 0]), "stored.3.rows: "),
        (put(f"current.{REVOLUTIONS * SLICE_NS}.rows", [99]), "rows: 99 given, must be below"),
        (put(f"current.{REVOLUTIONS * SLICE_NS}.rows", [1, 0]), "rows: must increase"),
        (lambda stored: stored.arrays.pop(f"filtered.{LAST}.weight"), "weight: missing"),
        (put(f"filtered.{LAST}.state", np.ones((1, 6))), r"shape \(1, 6\), expected \(T, 5\)"),
        (
            put(f"filtered.{LAST}.class_probability", np.ones((1, 2))),
            r"shape \(1, 2\), expected \(1, 1\)",
        ),
    ],
)
def test_restore_reports_what_is_wrong_and_leaves_a_new_engine(change, named):
    of, fresh = engine(lag=4), engine(lag=4)
    stepped_through(of, 0, LAST // SLICE_NS)
    held = stored_and_read(of.snapshot())
    change(held)
    with pytest.raises(ValueError, match=f"^snapshot: .*{named}"):
        of.restore(held)
    assert (
        stepped_through(of, 0, 3)[0][-1].weight.tolist()
        == stepped_through(fresh, 0, 3)[0][-1].weight.tolist()
    )


@pytest.mark.parametrize("later", [0, -SLICE_NS])
def test_restore_refuses_sets_that_do_not_increase(later):
    of = engine()
    stepped_through(of, 0, 2)
    held = stored_and_read(of.snapshot())
    for name in [name for name in held.arrays if name.startswith("stored.1.link")]:
        held.arrays.pop(name)
    put("stored.1.stamp_ns", SLICE_NS + later)(held)
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
    of.step(scan_of(-1))
    other.restore(stored_and_read(of.snapshot()))
    for one in (of, other):
        one.step(scan_of(0))
    assert [e.stamp_ns for e in of.flush()] == [e.stamp_ns for e in other.flush()] == [0, SLICE_NS]
    of = engine()
    of.step(scan_of(3))
    with pytest.raises(ValueError, match="not later than"):
        of.step(scan_of(3))


def test_stamp_before_all_sets_has_no_targets():
    of = engine()
    stepped_through(of, 0, 3)
    held = stored_and_read(of.snapshot())
    put("window.stamps_ns", [5, SLICE_NS, 2 * SLICE_NS])(held)
    of.restore(held)
    early, *others = of.flush()
    assert (early.stamp_ns, early.lag, len(early)) == (5, 2, 0)
    assert early.class_probability.shape == (0, len(MODEL.modes.classes))
    assert lengths(others) == [4, 4]


FILTER = ["predict", "update", "reduce", "extraction"]


def test_steps_report_their_parts_and_figures():
    of, parts = engine(lag=2), []
    of.forward.on_stage_end = parts.append
    figures = [of.step(scan_of(index)).figures for index in range(2)]
    assert [found["origins"] for found in figures] == [4, 4]
    assert parts == FILTER * 2
    of.step(scan_of(2))
    assert parts[8:] == [*FILTER, "backward", "extraction"]


def test_steps_by_period_report_the_same_parts():
    of, parts = engine(lag=2, period_ns=SLICE_NS * 3), []
    of.forward.on_stage_end = parts.append
    stepped_through(of, 0, 3)
    assert parts == FILTER * 3
    of.step(scan_of(3))
    assert len(of.flush()) == 1
    assert parts[12:] == [*FILTER, "backward", "extraction"]


def test_clutter_raster_is_of_the_radars_that_learn_a_map():
    assert engine().clutter_raster() is None
    of = engine()
    of.retune(configuration({"radar.clutter_map": True}).model, of.rule)
    (radar,), factors = of.forward.model.radars, of.forward.factors
    report, places = np.array([[20e3, 0.5]]), factors.find(radar.name, ClutterMap)
    for _ in range(30):
        places = places.after(report, radar.to_world(report), np.ones(1), 1.0)
    own = [places if isinstance(f, ClutterMap) else f for f in factors.by_sensor[radar.name]]
    of.forward.factors = factors.changed(by_sensor={radar.name: tuple(own)})
    drawn = of.clutter_raster()
    row, column = np.unravel_index(drawn.density.argmax(), drawn.density.shape)
    (place,) = radar.to_world(report)
    corner = drawn.corner + drawn.cell * np.array([column, row])
    assert np.abs(corner + 0.5 * drawn.cell - place).max() < 2.0 * radar.range_std


# --- Scans that come late -------------------------------------------------------------------------


@pytest.mark.parametrize("late", [2, 5, 7])
@pytest.mark.parametrize("period_ns", [0, 700_000_000])
@pytest.mark.parametrize("tuned", [None, 7])
def test_reprocessing_gives_the_engine_that_had_the_late_scan_in_time(late, period_ns, tuned):
    of, timely = (engine(lag=4, period_ns=period_ns) for _ in range(2))
    held, given = {}, ([], [])
    for index in range(9):
        if index == tuned:
            of.retune(MODEL, rule(0.9))
        if index != late:
            held[index] = of.save_state()
            assert held[index].stamp_ns == of.forward.stamp_ns
            for part, estimates in zip(given, stepped(of, [scan_of(index)]), strict=True):
                part.extend(estimates)
    again = [(held[max(index, late + 1)], scan_of(index)) for index in range(late, 9)]
    found = of.reprocess(again)

    before, every = [], ([], [])
    for index in range(9):
        if index == (late if tuned == late else tuned):
            timely.retune(MODEL, rule(0.9))
        before.append(timely.save_state())
        for part, estimates in zip(every, stepped(timely, [scan_of(index)]), strict=True):
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
