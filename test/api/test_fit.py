"""Parameters from a table of detections alone."""

import contextlib
import warnings

import crossing
import numpy as np
import pytest

from phd_jdtc_ros import Tracker, evaluate
from phd_jdtc_ros.earth import SystemPlane

DETECTIONS, TRUTH = crossing.detections(), crossing.truth()


@pytest.fixture(scope="module")
def fitted():
    """Return a tracker fitted to a recording alone."""
    return Tracker().fit(DETECTIONS)


def test_fit_alone_is_enough_to_track(fitted):
    scores = evaluate(TRUTH, fitted.track(DETECTIONS).smoothed, cutoff=50.0)
    assert scores["ospa"] < 8.0
    assert fitted.parameters["radar.range_std"] == pytest.approx(5.0, rel=0.25)
    assert fitted.parameters["radar.azimuth_std_deg"] == pytest.approx(0.5, rel=0.25)
    assert fitted.parameters["interval_s"] == 1.0


def test_fit_warns_of_degrees_that_are_read_as_radians():
    degrees = {**DETECTIONS, "azimuth": np.degrees(DETECTIONS["azimuth"])}
    expected = r"radar: \d+ azimuths beyond 2 pi rad; probably degrees"
    # It does not matter if targets are found in such azimuths.
    with pytest.warns(UserWarning, match=expected), contextlib.suppress(ValueError):
        Tracker().fit(degrees)


def test_fit_names_times_in_days():
    days = {**DETECTIONS, "time": 45_991.0 + DETECTIONS["time"] / 86_400.0}
    with pytest.raises(ValueError, match=r"1.2e-05 s, must be .*; these are probably hours or"):
        Tracker().fit(days)


def all_around(unit):
    """Return false detections in all directions; `unit` is a revolution in the unit of azimuths."""
    rng, count = np.random.default_rng(1), 240
    time = np.repeat(10.0 + np.arange(40.0), count // 40)
    return {
        "time": time,
        "range": rng.uniform(50.0, 1.4e3, count),
        "azimuth": unit * (rng.random(count) - 0.5),
    }


def test_fit_without_targets_says_that_degrees_are_read_as_radians():
    warned = pytest.warns(UserWarning, match=r"^radar: \d+ azimuths beyond 2 pi rad")
    with warned, pytest.raises(ValueError, match=r"distinct from clutter.*; \d+ azimuths beyond"):
        Tracker().fit(all_around(360.0))


def test_fit_warns_of_radians_that_are_read_as_degrees():
    added = all_around(2.0 * np.pi)
    both = {name: np.concatenate([DETECTIONS[name], added[name]]) for name in added}
    with pytest.warns(UserWarning, match=r"^radar: all azimuths are within 6\.3 degrees"):
        Tracker({"radar": {"units.azimuth": "deg"}}).fit(both)


def test_fit_warns_of_repeated_scans_and_leaves_them_out(fitted):
    twice = {name: np.tile(column, 2) for name, column in DETECTIONS.items()}
    twice["time"][len(DETECTIONS["time"]) :] += 0.05
    with pytest.warns(UserWarning, match=r"^radar: \d+ clouds that repeat all detections"):
        assert Tracker().fit(twice).parameters == fitted.parameters


def test_fit_keeps_targets_at_rest_and_says_so():
    rng, times = np.random.default_rng(5), np.unique(DETECTIONS["time"])
    places = np.array([[300.0, 0.5], [420.0, -2.0], [350.0, 2.0], [250.0, -1.0]])
    at_anchor = np.tile(places, (len(times), 1))
    at_anchor += rng.standard_normal(at_anchor.shape) * [5.0, np.radians(0.5)]
    added = {"time": np.repeat(times, len(places)), "range": at_anchor[:, 0]}
    added["azimuth"] = at_anchor[:, 1]
    both = {name: np.concatenate([DETECTIONS[name], added[name]]) for name in added}
    with pytest.warns(UserWarning, match=r"^radar: \d+ % .* may be of targets at rest") as said:
        fitted = Tracker().fit(both)
    assert len(said) == 1
    assert "radar.clutter_map" not in fitted.parameters
    found = fitted.track(both).smoothed
    end = found[found["time"] == times[-5]]
    x, y = places[:, 0] * np.cos(places[:, 1]), places[:, 0] * np.sin(places[:, 1])
    apart = np.hypot(np.subtract.outer(x, end["x"]), np.subtract.outer(y, end["y"]))
    assert apart.min(axis=1).max() < 15.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Tracker({"radar": {"clutter_map": False}}).fit(both)


def test_fit_goes_with_other_classes_and_motions():
    given = {
        "classes": ["boat", "ship"],
        "motions": ["straight"],
        "straight": {"noise_density": 0.1},
        **{name: {"motions": ["straight"], "mode_transition": [1.0]} for name in ("boat", "ship")},
    }
    found = Tracker(given).fit(DETECTIONS).track(DETECTIONS).smoothed
    assert evaluate(TRUTH, found, cutoff=50.0)["ospa"] < 8.0
    assert set(found["class"]) <= {"boat", "ship"}


def test_fit_adds_to_a_parameter_file(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "/**: {ros__parameters: {sensors: [only], only: {azimuth_std_deg: 0.5, fields.height: ''}}}"
    )
    tracker = Tracker(path).fit(DETECTIONS)
    assert tracker.parameters["only.range_std"] == pytest.approx(5.0, rel=0.25)
    assert tracker.parameters["only.azimuth_std_deg"] == 0.5


def test_fit_reports_what_a_recording_lacks():
    few = {name: column[:20] for name, column in DETECTIONS.items()}
    with pytest.raises(ValueError, match=r"radar: .* clouds .*, must be at least 10"):
        Tracker().fit(few)


def test_fit_takes_the_larger_deviation_for_both_axes_of_positions():
    noise = 20.0 * np.random.default_rng(6).standard_normal(len(DETECTIONS["time"]))
    given = crossing.cartesian(DETECTIONS)
    for axis in "xy":
        table = {**given, axis: given[axis] + noise}
        found = Tracker().fit(table).parameters["radar.position_std"]
        assert found == pytest.approx(20.0, rel=0.2)
    # Positions are not used beside ranges and azimuths.
    found = Tracker().fit({**DETECTIONS, **table}).parameters["radar.range_std"]
    assert found == pytest.approx(5.0, rel=0.25)


def through_zero(x=0.0, y=0.0, seed=11):
    """Return positions of a person who walks through (x, y), amid false ones, and the truth."""
    rng, times = np.random.default_rng(seed), 0.1 * np.arange(150)
    true = x + 1.2 * (times - 7.5), np.full(150, y)
    seen = np.array([times, *true]).T[rng.random(150) < 0.95]
    seen[:, 1:] += 0.08 * rng.standard_normal((len(seen), 2))
    false = [rng.choice(times, 150), x + rng.uniform(-15, 15, 150), y + rng.uniform(-15, 15, 150)]
    rows = np.concatenate([seen, np.transpose(false)]).T
    truth = {"time": times, "label": np.ones(150), "x": true[0], "y": true[1]}
    return dict(zip(("time", "x", "y"), rows, strict=True)), truth


@pytest.mark.parametrize("place", [(0.0, 0.0), (500e3, 5.4e6)], ids=["zero", "far UTM"])
def test_who_walks_through_a_place_of_a_table_of_positions_is_kept(place):
    detections, truth = through_zero(*place)
    found = Tracker().fit(detections).track(detections).smoothed
    scores = evaluate(truth, found, cutoff=1.0, times=np.unique(detections["time"]))
    assert len(set(found["label"].tolist())) == 1
    assert scores["missed"] < 0.02
    assert scores["position_rms"] < 0.06


def test_fit_counts_absurd_positions_and_tracks_as_without_them():
    table = crossing.cartesian(DETECTIONS)
    usual = Tracker().fit(table).track(table).smoothed
    more = {name: np.append(column, [12.0, 13.0]) for name, column in table.items()}
    more["x"][-2:], more["y"][-2:] = [1e160, 50.0], [70.0, 1e20]
    tracker = Tracker()
    with pytest.warns(UserWarning, match="2 of .* detections were not used: area 1, not_finite 1"):
        tracker.fit(more)
    with pytest.warns(UserWarning, match="2 of .* detections were not used: area 1, not_finite 1"):
        assert len(tracker.track(more).smoothed) == len(usual)


def test_fit_tracks_latitudes_and_longitudes_in_the_plane_about_their_middle():
    table, about = crossing.cartesian(DETECTIONS), SystemPlane((47.37, 8.54, 0.0))
    lat, lon = about.to_geodetic(table["x"], table["y"])
    tracker = Tracker().fit({"time": table["time"], "lat": lat, "lon": lon})
    found = tracker.track({"time": table["time"], "lat": lat, "lon": lon}).smoothed
    plane = SystemPlane(tracker.parameters["world_origin"])
    x, y = plane.to_plane(*about.to_geodetic(TRUTH["x"], TRUTH["y"]))
    assert evaluate({**TRUTH, "x": x, "y": y}, found, cutoff=50.0)["ospa"] < 8.0
    with (
        pytest.warns(UserWarning, match="if they are degrees, name them lon and lat"),
        pytest.raises(ValueError, match="distinct from clutter"),
    ):
        Tracker().fit({"time": table["time"], "x": lon, "y": lat})
    with pytest.raises(ValueError, match=r"lat: 97.*in row 1, must be from -90 to 90 degrees"):
        Tracker().fit({"time": table["time"], "lat": lat + 50.0, "lon": lon})


HERE = (47.37, 8.54, 0.0)


def on_earth(wrong=lambda lat, lon: (lat, lon)):
    """Return positions with latitudes and longitudes that something is done to."""
    table = crossing.cartesian(DETECTIONS)
    lat, lon = wrong(*SystemPlane(HERE).to_geodetic(table["x"], table["y"]))
    return {"time": table["time"], "lat": lat, "lon": lon}


def test_latitudes_and_longitudes_that_are_wrong_are_named_with_their_cause():
    def swapped(lat, lon):
        return lon, lat

    def radians(*both):
        return np.radians(both)

    given = {"world_origin": list(HERE)}
    for wrong, what in ((swapped, "swapped"), (radians, "in radians")):
        said = pytest.warns(
            UserWarning, match=rf"km from world_origin, and \d km if they are {what}"
        )
        with said, contextlib.suppress(ValueError):
            Tracker(given).fit(on_earth(wrong))
        tracker = Tracker().fit(on_earth())
        with pytest.warns(UserWarning, match=f"km if they are {what}; are they"):
            tracker.track(on_earth(wrong))
    with (
        pytest.warns(UserWarning, match="if they are in radians, convert them to degrees"),
        contextlib.suppress(ValueError),
    ):
        Tracker().fit(on_earth(radians))
    for factor, unit in ((1e7, "1e-7 degrees"), (6e5, "1/10000 minutes")):
        said = f"probably these are {unit}: divide both columns by {factor:.0f}"
        with pytest.raises(ValueError, match=said):
            Tracker().fit(on_earth(lambda lat, lon, by=factor: (by * lat, by * lon)))
    with pytest.raises(ValueError, match=r"lat: 1.*degrees; are lat and lon swapped"):
        Tracker().fit(on_earth(lambda lat, lon: (lon + 100.0, lat)))


@pytest.mark.parametrize("unknown", [(91.0, 181.0), (-999.0, -999.0)])
def test_number_that_stands_for_an_unknown_place_is_not_taken_for_another_unit(unknown):
    def some_unknown(*both):
        rare = np.arange(len(both[0])) % 15 == 3
        return [np.where(rare, own, column) for own, column in zip(unknown, both, strict=True)]

    said = rf"lat: {unknown[0]:g} in row 4.*leave lat and lon empty there$"
    with pytest.raises(ValueError, match=said):
        Tracker().fit(on_earth(some_unknown))


def test_degrees_and_minutes_in_one_number_are_named_as_such():
    def with_minutes(*both):
        return [100.0 * np.floor(each) + each % 1.0 * 60.0 for each in both]

    with pytest.raises(ValueError, match=r"degrees and minutes in one number: add minutes / 60"):
        Tracker().fit(on_earth(with_minutes))


def test_places_far_from_their_origin_are_no_fault(recwarn):
    tracker = Tracker({"world_origin": [40.0, 8.54, 0.0]})
    tracker.fit(on_earth()).track(on_earth())
    assert not [each for each in recwarn if "world_origin" in str(each.message)]


def test_fit_says_why_detections_cannot_be_used():
    levels = np.full(len(DETECTIONS["time"]), -80.0)
    with pytest.raises(ValueError, match=r"0 detections in .*: amplitude \d+ \(units.amplitude"):
        Tracker().fit({**DETECTIONS, "amplitude": levels})


def test_fit_keeps_the_recognised_columns():
    table = {**DETECTIONS, "height": np.full(len(DETECTIONS["time"]), 30.0)}
    tracker = Tracker({"radar": {"position": [0.0, 0.0, 30.0]}}).fit(table)
    assert tracker.parameters["radar.fields.height"] == "height"
    found = tracker.track(table).smoothed
    assert found["height"] == pytest.approx(30.0, abs=5.0)


def split_plots(share, seed=3):
    """Return detections of four targets that fly straight; a share of them are two plots."""
    rng = np.random.default_rng(seed)
    place = np.array([[-900.0, 300.0], [800.0, 500.0], [-300.0, -900.0], [900.0, -800.0]])
    velocity = np.array([[14.0, 2.0], [-9.0, 8.0], [5.0, 13.0], [-12.0, -3.0]])
    rows = []
    for time in range(60):
        x, y = (place + velocity * time).T
        seen = np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1)[rng.random(4) < 0.85]
        twice = rng.random(len(seen)) < share
        seen = np.concatenate([seen + twice[:, None] * [4.0, 0.008], seen[twice] - [4.0, 0.008]])
        seen += rng.standard_normal(seen.shape) * [4.0, 0.008]
        false = np.stack([rng.uniform(50.0, 2e3, 3), rng.uniform(-np.pi, np.pi, 3)], axis=1)
        rows += [[time, *each] for each in (*seen, *false)]
    return dict(zip(("time", "range", "azimuth"), np.transpose(rows), strict=True))


def twice(detections, apart, share=1.0, seed=9):
    """Return a table with a share of its rows repeated, that far apart in metres."""
    rng, count = np.random.default_rng(seed), len(detections["time"])
    again = np.flatnonzero(rng.random(count) < share)
    table = {name: np.concatenate([column, column[again]]) for name, column in detections.items()}
    table["range"] = table["range"] + apart * rng.standard_normal(len(table["range"]))
    return table


@pytest.mark.parametrize(("apart", "share"), [(0.02, 1.0), (1.0, 1.0), (0.02, 0.5)])
def test_plots_recorded_twice_make_no_second_track(apart, share):
    detections = twice(split_plots(0.0), apart, share)
    with pytest.warns(UserWarning, match=r"^radar: \d+ % .*Is every plot recorded twice\?") as said:
        tracker = Tracker().fit(detections)
    assert len(said) == 1
    assert tracker.parameters["radar.clutter_rate"] == pytest.approx(3.0, rel=0.1)
    assert tracker.parameters["radar.range_std"] == pytest.approx(4.0, rel=0.15)
    found = tracker.track(detections).filtered
    times, count = np.unique(found["time"], return_counts=True)
    assert 3.5 < count[times >= 10.0].mean() < 4.5


def test_track_warns_of_plots_recorded_twice():
    tracker = Tracker().fit(split_plots(0.0))
    with pytest.warns(UserWarning, match=r"^radar: \d+ detections with another .* recorded twice"):
        tracker.track(twice(split_plots(0.0, seed=4), 0.02))


def test_plots_split_in_two_make_no_second_track():
    counts = []
    for seed in (3, 4, 5):
        detections = split_plots(0.3, seed)
        with pytest.warns(UserWarning, match="another one within their noise"):
            tracker = Tracker().fit(detections)
        assert 3.0 < tracker.parameters["radar.cluster_distance"] < 5.0
        found = tracker.track(detections).filtered
        times, count = np.unique(found["time"], return_counts=True)
        counts.append(count[times >= 10.0].mean())
    assert np.mean(counts) < 4.5
    assert "radar.cluster_distance" not in Tracker().fit(split_plots(0.0)).parameters
