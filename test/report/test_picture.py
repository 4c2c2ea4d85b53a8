"""What the page's picture of the traffic is given to draw."""

from dataclasses import replace

import numpy as np
import pytest
from records import SCANS, estimates_of, record_of, shrunk, stamp_ns, truth_of, without_amplitudes
from unfolded import columns_of, rows_of

from msg_adapters.targets.markers import class_colour
from phd_jdtc_ros.asterix.messages import CallSigns
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, UNKNOWN, Attributes, Reported
from phd_jdtc_ros.core.types.clutter_raster import ClutterRaster
from phd_jdtc_ros.core.types.reports import LEFT, MMSI
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.report.page import words
from phd_jdtc_ros.report.page.picture import MARKS, Frames, picture_of
from phd_jdtc_ros.report.record import RadarPlots
from phd_jdtc_ros.report.style import RADIUS_95

PLANE = SystemPlane((52.3, 4.8, 5.0))


def tracked(scan, source="filtered", classes=2, **changes):
    """Return estimates with track numbers 4, 5 and so on."""
    found = estimates_of(scan, classes, 0 if source == "filtered" else 5)
    return replace(found, **{"track_id": 4 + np.arange(classes), **changes})


def flying(scan=0, **changes):
    """Return two aircraft: one at 3000 m that climbs, with a code, and one of unknown height."""
    attributes = Attributes(
        np.array([[3043.0, 5.0], [np.nan, np.nan]]),
        np.tile(np.eye(2), (2, 1, 1)),
        np.array([0o7700, UNKNOWN]),
        np.array([UNKNOWN, 0xABC]),
    )
    return tracked(scan, attributes=attributes, **changes)


def test_frames_are_stamps_of_estimates_or_of_what_there_is():
    record = record_of(
        truth=(truth_of(5, 2), truth_of(0, 2)),
        filtered=(estimates_of(3, 2, 0),),
        smoothed=(estimates_of(2, 2, 5), estimates_of(3, 2, 5)),
    )
    assert Frames.of(record).stamp_ns.tolist() == [stamp_ns(2), stamp_ns(3)]
    record = record_of(filtered=(), smoothed=(), truth=(truth_of(SCANS, 2),))
    assert Frames.of(record).stamp_ns.tolist() == [stamp_ns(k) for k in range(SCANS + 1)]
    frames = Frames(np.array([10, 20, 30]))
    assert frames.at([5, 10, 11, 30, 99]).tolist() == [0, 0, 1, 2, 2]


def test_frames_of_a_long_run_are_some_of_its_stamps(monkeypatch):
    monkeypatch.setattr("phd_jdtc_ros.report.page.picture.MOST", 5)
    assert Frames.of(record_of()).stamp_ns.tolist() == [stamp_ns(k) for k in (0, 3, 6, 9)]


def test_the_last_frame_with_most_targets_is_shown_first():
    record = record_of(2, truth=tuple(truth_of(k, 2 if 3 <= k <= 6 else 1) for k in range(SCANS)))
    assert picture_of(record).header["first"] == 6


@pytest.mark.parametrize("source", ["filtered", "smoothed"])
@pytest.mark.parametrize("made", [lambda record: record, shrunk], ids=["km", "m"])
def test_estimates_are_where_they_were_one_track_after_the_other(source, made):
    record = made(record_of(2, **{source: tuple(tracked(k, source) for k in range(SCANS))}))
    picture = picture_of(record)
    rows = rows_of(picture, source)
    assert rows["number"].tolist() == [4] * SCANS + [5] * SCANS
    assert rows["frame"].tolist() == [*range(SCANS)] * 2
    for row, (number, scan) in enumerate(zip(rows["number"], rows["frame"], strict=True)):
        place = record.of_source(source)[scan].position[number - 4]
        assert rows["place"][row] == pytest.approx(place, abs=picture.header["quantum"])


def test_places_are_stored_to_a_hundred_thousandth_of_the_picture():
    header = picture_of(record_of(2)).header
    assert header["quantum"] <= header["extent"][0] / 1e4


def test_estimates_list_velocity_course_state_and_probability():
    state = np.array(estimates_of(0, 1, 0).state)
    state[0, [1, 3]] = [-30.0, 0.0]
    given = tracked(0, classes=1, state=state, weight=np.array([0.25]))
    given = replace(given, track_state=np.array([COASTING]))
    rows = rows_of(picture_of(record_of(1, filtered=(given,), smoothed=())), "filtered")
    names = ("vx", "vy", "course", "share", "weight", "state")
    assert [int(rows[name][0]) for name in names] == [-300, 0, 270, 100, 25, COASTING]
    assert CONFIRMED != COASTING


def test_ellipses_and_radii_hold_95_per_cent():
    picture = picture_of(record_of(2))
    rows = rows_of(picture, "smoothed")
    steps, least = picture.header["axis"]
    # Standard deviations of 30 m along x and 20 m along y.
    assert least * 2.0 ** (rows["major"][0] / steps) == pytest.approx(30.0 * RADIUS_95, rel=0.03)
    assert least * 2.0 ** (rows["minor"][0] / steps) == pytest.approx(20.0 * RADIUS_95, rel=0.03)
    assert rows["angle"][0] % 180 == 0
    points = np.random.default_rng(0).standard_normal((200_000, 2))
    inside = np.hypot(*points.T) < RADIUS_95
    assert inside.mean() == pytest.approx(0.95, abs=0.002)


@pytest.mark.parametrize(("plane", "level"), [(None, 100), (PLANE, 100)])
def test_levels_are_hundreds_of_feet_where_aircraft_fly(plane, level):
    record = replace(record_of(2, filtered=(flying(),), smoothed=()), plane=plane)
    picture = picture_of(record)
    rows = rows_of(picture, "filtered")
    assert picture.header["levels"] == "FL"
    assert rows["level"].tolist() == [level, picture.header["no_level"]]
    assert rows["climb"].tolist() == [50, 0]


def test_levels_and_ground_traffic_are_of_aircraft():
    low = Attributes(np.array([[2.0, 0.0]]), np.zeros((1, 2, 2)), np.array([-1]), np.array([-1]))
    given = tracked(0, classes=1, attributes=low)
    picture = picture_of(record_of(1, filtered=(given,), smoothed=()))
    assert picture.header["levels"] == "m"
    assert picture.header["ground"] is None
    assert rows_of(picture, "filtered")["level"].tolist() == [2]
    ground = picture_of(record_of(2, filtered=(flying(),), smoothed=())).header["ground"]
    # The lowest is at flight level 100.
    assert 100 < ground["level"] < 120
    aircraft = words.section(picture_of(record_of(2, filtered=(flying(),))).header)
    others = words.section(picture_of(record_of(2)).header)
    for offered in ("Flight level from", "ground traffic", ">level</button></th>"):
        assert (offered in aircraft, offered in others) == (True, False)


def test_a_drone_that_hovers_high_is_not_on_the_ground():
    high = Attributes(np.array([[340.0, 0.0]]), np.ones((1, 2, 2)), np.array([-1]), np.array([-1]))
    flat = tracked(0, classes=1)
    given = replace(
        flat,
        attributes=high,
        space=SPATIAL,
        state=np.pad(flat.state, ((0, 0), (0, 2))),
        covariance=np.pad(flat.covariance, ((0, 0), (0, 2), (0, 2))),
    )
    header = picture_of(record_of(1, filtered=(given,), smoothed=())).header
    assert (header["levels"], header["ground"]) == ("m", None)


def test_identities_are_codes_and_addresses_of_the_time():
    unknown = replace(flying(1), attributes=Attributes.unknown(2))
    picture = picture_of(record_of(2, filtered=(unknown, flying(2)), smoothed=()))
    rows = rows_of(picture, "filtered")
    identities = [picture.header["identities"][k] for k in rows["identity"]]
    assert identities == [["", "", ""], ["7700", "", ""], ["", "", ""], ["", "000ABC", ""]]


def test_identities_have_the_call_sign_of_the_address():
    signs = CallSigns()
    signs.take(0xABC, 0x2CC371CA0820)
    record = record_of(2, filtered=(flying(2),), smoothed=(), call_signs=signs)
    identities = picture_of(record).header["identities"]
    assert identities == [["7700", "", ""], ["", "000ABC", "KLM12"]]


def test_truth_is_where_it_was_at_the_frames():
    fast = np.array([0.0, 50.0, 0.0, 0.0, 0.0])
    truth = tuple(replace(truth_of(k, 1), state=truth_of(k, 1).state + fast) for k in (0, 1))
    between = tracked(0, classes=1, stamp_ns=(stamp_ns(0) + stamp_ns(1)) // 2)
    record = record_of(1, truth=truth, filtered=(between,), smoothed=())
    rows = rows_of(picture_of(record), "truth")
    # Half way between its samples.
    assert rows["place"][0] == pytest.approx([150.0, 0.0], abs=0.1)
    assert (rows["number"].tolist(), rows["speed"].tolist()) == ([1], [500])


def test_truth_that_is_gone_for_a_while_has_no_rows_meanwhile():
    there = tuple(truth_of(k, 1 if 3 <= k < 9 else 2) for k in range(SCANS))
    rows = rows_of(picture_of(record_of(2, truth=there)), "truth")
    assert rows["frame"][rows["number"] == 2].tolist() == [0, 1, 2, 9, 10, 11]


def test_detections_have_places_shades_and_radars_in_order_of_frames():
    late = RadarPlots(stamp_ns(1), "b", np.array([[100.0, 0.0]]), np.array([np.nan]))
    early = RadarPlots(stamp_ns(0), "a", np.array([[5e3, 1e3], [0.0, 0.0]]), np.array([1.0, 100.0]))
    picture = picture_of(record_of(plots=(late, early)))
    rows = rows_of(picture, "plots")
    assert rows["frame"].tolist() == [0, 0, 1]
    assert rows["place"][0] == pytest.approx([5e3, 1e3], abs=0.1)
    assert [picture.header["radars"][k] for k in rows["radar"]] == ["a", "a", "b"]
    assert rows["shade"].tolist() == [0, 7, -1]
    assert picture.header["amplitudes"] == [1.0, 100.0]


def test_detections_without_amplitudes_have_no_scale_of_them():
    header = picture_of(without_amplitudes(record_of(2))).header
    assert header["amplitudes"] == []
    assert "amplitude" not in words.section(header)


def test_radars_that_move_are_where_they_were():
    moving = [
        RadarPlots(stamp_ns(k), "mast", np.zeros((0, 2)), np.zeros(0), sensor=(100.0 * k, 7.0))
        for k in range(3)
    ]
    rows = rows_of(picture_of(record_of(plots=tuple(moving))), "carriers")
    assert rows["place"] == pytest.approx(np.array([[0, 7], [100, 7], [200, 7]]), abs=0.1)


def test_picture_holds_all_targets_or_detections():
    header = picture_of(record_of(3)).header
    low, high = np.array(header["corner"]), np.array(header["corner"]) + header["extent"]
    assert (low < 0.0).all()
    assert (high > [3340.0, 4040.0]).all()
    header = picture_of(record_of(truth=(), filtered=(), smoothed=())).header
    assert header["corner"][0] < -5e3
    assert header["corner"][1] + header["extent"][1] > 4e3
    assert picture_of(record_of(truth=(), plots=(), filtered=(), smoothed=())) is None


def test_classes_and_learned_clutter_have_their_colours():
    named = replace(record_of(2), class_names=("car", "<van>"))
    header = picture_of(named).header
    assert [kind["title"] for kind in header["classes"]] == ["car", "<van>"]
    assert [kind["colour"] for kind in header["classes"]] == [class_colour(0), class_colour(1)]
    assert "&lt;van&gt;" in words.section(header)
    learned = ClutterRaster((-3000.0, 1000.0), 50.0, np.array([[0.0, 10.0], [1000.0, 0.0]]))
    picture = picture_of(replace(record_of(2), clutter=learned))
    clutter = picture.header["clutter"]
    assert (clutter["corner"], clutter["cell"], clutter["shape"]) == ([-3e3, 1e3], 50.0, [2, 2])
    columns = columns_of(picture.columns.text(), picture.columns.index)
    assert columns["clutter"].tolist() == [0, 33, 100, 0]
    assert "brown squares" in words.section(picture.header)


@pytest.mark.parametrize(
    ("made", "title"),
    [(flying, "ground traffic"), (tracked, "class 1, untracked")],
    ids=["aircraft", "others"],
)
def test_traffic_of_a_class_that_is_not_tracked_is_named_so(made, title):
    one = replace(record_of(2, filtered=(made(0),), smoothed=()), classes=1)
    assert [kind["title"] for kind in picture_of(one).header["classes"]] == ["class 0", title]


def test_an_hour_of_fifty_aircraft_is_less_than_two_megabytes():
    rng = np.random.default_rng(5)
    aircraft, revolutions = 50, 900
    start = rng.uniform(-1e5, 1e5, (aircraft, 2))
    velocity = rng.uniform(-200.0, 200.0, (aircraft, 2))

    def sets(lag):
        for k in range(revolutions):
            state = np.zeros((aircraft, 5))
            state[:, [0, 2]] = start + 4.0 * k * velocity + rng.normal(0.0, 30.0, (aircraft, 2))
            state[:, [1, 3]] = velocity + rng.normal(0.0, 3.0, (aircraft, 2))
            spread = np.diag([900.0, 9.0, 900.0, 9.0, 1e-6])
            yield replace(
                estimates_of(0, 1, lag),
                stamp_ns=stamp_ns(0) + k * 4_000_000_000,
                state=state,
                covariance=spread * rng.uniform(0.9, 1.1, (aircraft, 1, 1)),
                weight=np.ones(aircraft),
                class_probability=np.ones((aircraft, 1)),
                class_id=np.zeros(aircraft),
                track_id=1 + np.arange(aircraft),
                track_state=np.full(aircraft, CONFIRMED),
            )

    filtered, smoothed = tuple(sets(0)), tuple(sets(5))
    plots = tuple(
        RadarPlots(entry.stamp_ns, "radar_1", entry.position, np.full(aircraft, np.nan))
        for entry in filtered
    )
    record = record_of(1, truth=(), plots=plots, filtered=filtered, smoothed=smoothed)

    # The charts' library takes two of the five that a page of an hour may have.
    assert len(picture_of(record).columns.text()) < 2e6


def test_what_self_reports_say_is_a_mark_with_its_chance_and_time():
    said = Reported.unknown(5)
    columns = {name: value.copy() for name, value in vars(said).items()}
    columns["owned"][:] = [0.98, 0.0, 0.0, 0.0, 0.0]
    columns["dark"][1] = 0.995
    columns["doubtful"][2] = 1.0
    columns["reason"][3] = LEFT
    columns["silent"][4] = 0.3
    columns["address"][:4], columns["space"][:4] = 211_000_001, MMSI
    columns["heard_ns"][0] = stamp_ns(0) - 7 * 10**9
    columns["since_ns"][2:4] = stamp_ns(0) - 12 * 10**9
    found = tracked(0, classes=5, reports=Reported(**columns))
    record = record_of(5, filtered=(found,), smoothed=())
    picture = picture_of(record)
    shown = rows_of(picture, "filtered")
    words_of = [MARKS[mark] for mark in shown["mark"]]
    assert words_of == ["reports", "dark", "doubtful", "left by", "no report"]
    assert shown["chance"].tolist()[:3] == [98, 100, 100]
    assert shown["since"].tolist() == [7, -1, 12, 12, -1]
    told = picture.header["told"]
    assert [told[k] for k in shown["source"]] == ["MMSI 211000001"] * 4 + [""]
    assert "thick one about a dark target" in words.section(picture.header)


def test_tracks_without_a_receiver_have_no_marks():
    assert "filtered.mark" not in dict(picture_of(record_of(2)).header["columns"])
