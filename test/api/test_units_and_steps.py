"""Tables in other units than metres and seconds, and of clocks that were set back: named."""

import re
import warnings

import numpy as np
import pytest

from phd_jdtc_ros import Tracker

FOOT, KNOT, NAUTICAL_MILE = 0.3048, 1852.0 / 3600.0, 1852.0
SCANS, INTERVAL_S = 60, 2.0


def recording(seed=0, std=(20.0, 0.0017), clutter=3.0, detected=0.9):
    """Return a table of four aircraft within 30 km, by scans, with range rates."""
    rng = np.random.default_rng(seed)
    begin, velocity = rng.uniform(-15e3, 15e3, (4, 2)), rng.uniform(-120.0, 120.0, (4, 2))
    rows = []
    for scan in range(SCANS):
        place = begin + INTERVAL_S * scan * velocity
        slant = np.hypot(*place.T)
        rate = (place * velocity).sum(axis=1) / slant + 0.5 * rng.standard_normal(4)
        seen = np.column_stack([slant, np.arctan2(place[:, 1], place[:, 0])])
        seen = np.column_stack([seen + rng.standard_normal((4, 2)) * std, rate])
        low, high = [500.0, -np.pi, -150.0], [30e3, np.pi, 150.0]
        false = rng.uniform(low, high, (rng.poisson(clutter), 3))
        found = np.concatenate([seen[rng.random(4) < detected], false])
        rows.append(np.column_stack([np.full(len(found), INTERVAL_S * scan), found]))
    return dict(
        zip(("time", "range", "azimuth", "range_rate"), np.concatenate(rows).T, strict=True)
    )


def without(table, *names):
    return {name: column for name, column in table.items() if name not in names}


def in_plane(table):
    x, y = (table["range"] * of(table["azimuth"]) for of in (np.cos, np.sin))
    return {"time": table["time"], "x": x, "y": y}


def said(table, parameters=None, track=False):
    """Return what is said of a table, sorted."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        tracker = Tracker(parameters).fit(table)
        if track:
            tracker.track(table)
    return sorted({str(each.message) for each in found})


@pytest.mark.parametrize(
    ("lengths", "rates", "cause"),
    [
        (1.0 / FOOT, 1.0, "ranges are in feet"),
        (1e-3, 1.0, "ranges are in kilometres, or times in milliseconds"),
        (1.0, 3.6, "range rates are in km/h"),
        (1.0, 1.0 / KNOT, "range rates are in knots"),
        (1.0, -1.0, "range rates are positive for what approaches"),
        (1.0, 0.5, "one of them is in another unit"),
    ],
)
def test_units_that_contradict_each_other_are_named(lengths, rates, cause):
    table = recording(3)
    table |= {"range": lengths * table["range"], "range_rate": rates * table["range_rate"]}
    (text,) = said(table)
    assert f"; probably {cause}: metres and metres per second are expected" in text


@pytest.mark.parametrize("seed", range(3))
def test_units_that_agree_are_not_named(seed):
    assert said(recording(seed), track=True) == []


@pytest.mark.parametrize("factor", [1e-3, 1.0 / NAUTICAL_MILE])
def test_kilometres_and_nautical_miles_are_named_without_velocities(factor):
    table = without(recording(4), "range_rate")
    for each in (table, in_plane(table)):
        lengths = {"range", "x", "y"} & {*each}
        scaled = {**each, **{name: factor * each[name] for name in lengths}}
        try:
            (text,) = said(scaled)
        except ValueError as error:
            text = str(error)
        assert re.search(
            "in kilometres(, multiply them by 1000, and if in| or) nautical mile", text
        )


def test_people_who_stand_in_a_room_are_no_small_world():
    rng, times = np.random.default_rng(11), np.repeat(0.2 * np.arange(100), 3)
    place = np.tile([[1.0, 2.0], [-2.0, 1.0], [3.0, -1.0]], (100, 1))
    x, y = (place + 0.05 * rng.standard_normal(place.shape)).T
    assert not any("kilometres" in text for text in said({"time": times, "x": x, "y": y}))


@pytest.mark.parametrize(("what", "factor"), [("time", 1.0 / 60.0), ("range", 1000.0)])
def test_speeds_that_no_target_has_are_named(what, factor):
    table = without(recording(9), "range_rate")
    (text,) = said({**table, what: factor * table[what]})
    assert "if times are in minutes, multiply them by 60, and if ranges are in centi" in text


def test_a_unit_in_the_name_of_a_column_is_named():
    table = without(recording(5), "range_rate")
    table["range_ft"] = table.pop("range") / FOOT
    (text,) = said(table, {"radar.fields.range": "range_ft"}, track=True)
    assert text.startswith("radar: a name in radar.fields has another unit than metres")
    table["drift"] = table.pop("range_ft") * FOOT
    assert said(table, {"radar.fields.range": "drift"}, track=True) == []


@pytest.mark.parametrize("step", [0.0, 1.0, 50.0])
def test_data_without_noise_draw_no_warning_of_it(step):
    table = without(recording(6, (0.0, 0.0), 0.0, 1.0), "range_rate")
    if step:
        table["range"] = step * np.rint(table["range"] / step)
    assert said(table, track=True) == []


def test_a_clock_that_was_set_back_is_named_with_its_row():
    table = without(recording(7), "range_rate")
    row = int(np.searchsorted(table["time"], 60.0))
    step = table["time"][row - 1] - (table["time"][row] - 30.0)
    late = np.arange(len(table["time"])) >= row
    table["time"] = np.where(late, table["time"] - 30.0, table["time"])
    (text,) = said(table, track=True)
    assert text.startswith(
        f"time: steps back by {step:g} s in row {row + 1}, and otherwise ascends"
    )


def test_a_clock_that_stopped_is_named_with_its_row():
    table = without(recording(12), "range_rate")
    row = int(np.searchsorted(table["time"], 60.0))
    table["time"] = np.minimum(table["time"], 60.0)
    (text,) = said(table)
    rows = len(table["time"])
    assert text.startswith(f"time: {rows - row} of {rows} rows have the time of row {row + 1}, and")


def test_a_burst_of_false_detections_is_no_stopped_clock():
    table, rng = without(recording(13), "range_rate"), np.random.default_rng(13)
    burst = {"time": np.full(80, 60.0), "range": rng.uniform(500.0, 30e3, 80)}
    burst["azimuth"] = rng.uniform(-np.pi, np.pi, 80)
    assert said({name: np.append(table[name], burst[name]) for name in burst}) == []


def test_tables_by_target_and_in_any_order_are_no_clocks_set_back():
    table = without(recording(8), "range_rate")
    rng = np.random.default_rng(0)
    target = rng.integers(0, 4, len(table["time"]))
    for order in (np.lexsort((table["time"], target)), rng.permutation(len(target))):
        assert said({name: column[order] for name, column in table.items()}) == []
