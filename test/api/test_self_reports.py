"""Tables of self-reports beside detections."""

from __future__ import annotations

import re

import numpy as np
import pytest
from harbour import KINDS, OK, PARAMETERS, turns

from phd_jdtc_ros import Tracker
from phd_jdtc_ros.api.reports import told_of
from phd_jdtc_ros.api.tables import columns_of
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.earth import SystemPlane

SCENE = turns(1, 100.0)


def tables():
    """Return the detections and the self-reports of the scene as tables."""
    plots = [(turn.stamp_ns * 1e-9, *row) for turn in SCENE for row in turn.plots.measurement]
    amplitude = np.concatenate([turn.plots.amplitude for turn in SCENE])
    time, distance, azimuth = np.array(plots).T
    detections = {"time": time, "range": distance, "azimuth": azimuth, "amplitude": amplitude}
    told = [turn.reports for turn in SCENE if len(turn.reports)]
    reports = {
        "time": np.concatenate([each.time_ns for each in told]) * 1e-9,
        **dict(zip("xy", np.concatenate([each.position for each in told]).T, strict=True)),
        **dict(zip(("vx", "vy"), np.concatenate([each.velocity for each in told]).T, strict=True)),
        "std": np.full(sum(map(len, told)), 8.0),
        "address": np.concatenate([each.address for each in told]),
        "name": np.array([f"SHIP {a}" for each in told for a in each.address]),
    }
    return detections, reports


def test_track_joins_reports_with_tracks():
    detections, reports = tables()
    tracks = Tracker(PARAMETERS).track(detections, reports).filtered
    last = tracks[tracks["time"] == tracks["time"].max()]
    place = SCENE[-1].truth[KINDS.index(OK)]
    row = np.argmin(np.hypot(last["x"] - place[0], last["y"] - place[1]))
    assert last["source"][row] == "SHIP 1001 (MMSI 1001)"
    assert last["owned"][row] > 0.99
    assert last["dark"].max() > 0.99


def test_update_equals_track():
    detections, reports = tables()
    whole = Tracker(PARAMETERS).track(detections, reports).filtered
    tracker, found = Tracker(PARAMETERS), []
    for turn in SCENE:
        at = np.isclose(detections["time"], turn.stamp_ns * 1e-9, atol=1e-3, rtol=0.0)
        since = (reports["time"] > turn.stamp_ns * 1e-9 - 2.5) & (
            reports["time"] <= turn.stamp_ns * 1e-9
        )
        plots = {name: column[at] for name, column in detections.items() if name != "time"}
        told = {name: column[since] for name, column in reports.items()}
        time = float(turn.stamp_ns * 1e-9)
        found.append(tracker.update(time, plots, reports=told if since.any() else None).filtered)
    found.append(tracker.flush().filtered)
    steps = np.concatenate(found)
    np.testing.assert_array_equal(steps["x"], whole["x"])
    np.testing.assert_array_equal(steps["owned"], whole["owned"])


def test_reports_need_a_receiver_and_places():
    detections, reports = tables()
    alone = {name: value for name, value in PARAMETERS.items() if not name.startswith("ais.")}
    with pytest.raises(ValueError, match="none of the sensors has kind: reports"):
        Tracker(alone | {"sensors": ["radar"]}).track(detections, reports)
    del reports["y"]
    with pytest.raises(ValueError, match="no columns lat and lon, or x and y"):
        Tracker(PARAMETERS).track(detections, reports)


def test_latitudes_and_longitudes_of_reports_have_the_names_of_those_of_detections():
    config = resolve(PARAMETERS | {"world_origin": [54.0, 10.0, 0.0]}, SystemPlane)
    places = np.array([54.1, 54.2]), np.array([10.1, 10.3])
    found = [
        told_of(columns_of({"time": [1.0, 2.0], **dict(zip(names, places, strict=True))}), config)
        for names in (("lat", "lon"), ("latitude", "longitude"))
    ]
    (_, told), (_, same) = found[0][0], found[1][0]
    assert len(told.reports) == 2
    np.testing.assert_array_equal(told.reports.position, same.reports.position)


def test_a_clock_that_stands_still_is_named():
    detections, reports = tables()
    mine = reports["address"] == 1001 + KINDS.index(OK)
    reports["time"] = np.where(mine, reports["time"].min(), reports["time"])
    with pytest.warns(UserWarning, match=f"{mine.sum()} places of address 1001 .* clock"):
        Tracker(PARAMETERS).track(detections, reports)


def _sent(**changed):
    """Return reports of a ship to the north-east at 8 m/s, with some columns changed."""
    time = np.arange(0.0, 200.0, 10.0)
    step = 8.0 * np.sqrt(0.5) * time / 111_200.0
    places = {"lat": 54.0 + step, "lon": 8.0 + step / np.cos(np.radians(54.0))}
    ones = np.ones(len(time))
    moving = {"speed": 8.0 * ones, "course": 45.0 * ones, "heading": 511.0 * ones}
    sent = {"time": time, "address": 211_000_001 * ones, **places, **moving}
    return sent | {name: change(sent[name]) for name, change in changed.items()}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({}, None),
        ({"course": lambda own: 10.0 * own}, "20 of 20 values of course are beyond 360 .* tenths"),
        ({"heading": lambda own: own - 60.0}, "20 of 20 values of heading are beyond 360"),
        ({"speed": lambda own: 1.944 * own}, "1.94 times .* if they are knots, divide"),
        ({"speed": lambda own: 19.44 * own}, "19.4 times .* if they are tenths of a knot"),
        ({"speed": lambda own: 3.6 * own}, "3.[56].* times .* if they are km/h"),
        ({"speed": lambda own: np.where(own.cumsum() < 17.0, 102.3, own)}, "102.3 or 1023 in 2 of"),
        ({"lat": lambda own: 6e5 * own, "lon": lambda own: 6e5 * own}, "1/10000 minutes: divide"),
        ({"lat": lambda own: 1e7 * own, "lon": lambda own: 1e7 * own}, "1e-7 degrees: divide"),
    ],
)
def test_reports_in_other_units_are_named(changed, said, recwarn):
    origin = {"world_origin": [54.0, 8.0, 0.0], "interval_s": 2.0}
    config = resolve({"sensors": ["ais"], "ais.kind": "reports", **origin}, SystemPlane)
    told_of(columns_of(_sent(**changed)), config)
    assert len(recwarn) == (said is not None)
    if said is not None:
        assert re.search(said, str(recwarn[0].message))


def test_reports_alone_are_tracked():
    _, reports = tables()
    given = {name: value for name, value in PARAMETERS.items() if not name.startswith("radar.")}
    alone = given | {"sensors": ["ais"]}
    # A recording of it can be scored, although no radar has a clutter map.
    assert resolve(alone).least_speed == 0.0
    tracker = Tracker(alone)
    whole = tracker.track(None, reports).filtered
    last = whole[whole["time"] == whole["time"].max()]
    assert last["alone"].all()
    assert set(last["source"]) == {f"SHIP {a} (MMSI {a})" for a in np.unique(reports["address"])}
    place = SCENE[-1].truth[KINDS.index(OK)]
    assert np.hypot(last["x"] - place[0], last["y"] - place[1]).min() < 100.0
    # One report with a time of tomorrow moves no clock.
    wrong = {name: np.append(column, column[-1:]) for name, column in reports.items()}
    wrong["time"][-1] += 86_400.0
    again = tracker.track(None, wrong).filtered
    assert again["time"].max() == pytest.approx(whole["time"].max(), abs=5.0)
    found = [
        tracker.update(float(t), reports={n: c[reports["time"] == t] for n, c in reports.items()})
        for t in np.unique(reports["time"])
    ]
    found.append(tracker.flush())
    steps = np.concatenate([each.filtered for each in found])
    ended = steps[steps["time"] == whole["time"].max()]
    assert sorted(ended["source"]) == sorted(last["source"])
