from collections import Counter

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from samples import FRAME, STAMP_NS, cloud, detections, polar, radar
from sensor_msgs.msg import PointCloud2, PointField

from msg_adapters.encoding import RejectedMessageError, point_cloud, stamps
from msg_adapters.incoming import detections as adapter
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.core.types import Detections

F4, F8 = PointField.FLOAT32, PointField.FLOAT64
GOOD = [(1000.0, 0.5, 4.0), (2000.0, -0.5, 8.0)]
INF, NAN = np.inf, np.nan


def read(points, **changes):
    return adapter.from_msg(polar(points, F8), radar(**changes))


def test_to_msg_keeps_the_contract_of_the_topic():
    message = adapter.to_msg(detections(), STAMP_NS, FRAME)
    names = ["x", "y", "z", "range", "azimuth", "elevation", "amplitude"]
    assert [(f.name, f.datatype) for f in message.fields] == [(name, F4) for name in names]
    assert message.header == stamps.header(STAMP_NS, FRAME)
    given = Detections(np.array([[100.0, np.pi / 2], [200.0, -np.pi / 4]]), np.array([3.0, 4.0]))
    points = np.frombuffer(bytes(adapter.to_msg(given, 0, FRAME).data), dtype="<f4").reshape(2, 7)
    side = 200.0 / np.sqrt(2.0)
    assert_allclose(points[:, :3], [[0.0, 100.0, 0.0], [side, -side, 0.0]], atol=1e-4)
    assert_allclose(points[:, 3:5], given.measurement, rtol=1e-7)
    assert_array_equal(points[:, 5:], [[0.0, 3.0], [0.0, 4.0]])
    with pytest.raises(ValueError, match="amplitude: None given"):
        adapter.to_msg(Detections(np.zeros((1, 2)), None), 0, FRAME)


LAYOUTS = {
    "own": {},
    "compass": {"compass": True},
    "degrees": {"azimuth_in_degrees": True},
    "compass_degrees": {"compass": True, "azimuth_in_degrees": True},
    "decibels": {"amplitude_in_db": True, "amplitude_offset_db": -17.0},
    "offset": {"amplitude_offset_db": 6.0},
    "renamed": {"range_field": "rho", "azimuth_field": "theta", "amplitude_field": "snr"},
    "slant": {"elevation_field": "angle"},
    "swapped": {"range_field": "elevation", "azimuth_field": "range"},
    "without": {"amplitude_field": ""},
}


@pytest.mark.parametrize("changes", LAYOUTS.values(), ids=LAYOUTS)
def test_to_msg_writes_what_from_msg_reads_in_the_layout_of_the_radar(changes):
    given = Detections(
        np.array([[100.0, np.pi / 2], [16e3, -np.pi / 4], [5.0, 3.0]]), np.array([3.75, 250, 9e5])
    )
    layout = radar(**changes)
    report = adapter.from_msg(adapter.to_msg(given, STAMP_NS, FRAME, layout), layout)
    assert report.stamp_ns == STAMP_NS
    assert not report.dropped
    assert_allclose(report.detections.measurement, given.measurement, rtol=0.0, atol=1e-6)
    if layout.fields.amplitude:
        assert_allclose(report.detections.amplitude, given.amplitude, rtol=1e-5)
    else:
        assert report.detections.amplitude is None


@pytest.mark.parametrize("fields", [{}, {"time": "time", "sector": "sector", "height": "height"}])
def test_a_new_cloud_with_nothing_in_it_is_an_empty_scan(fields):
    """Drivers publish it where they have no detections."""
    message = PointCloud2(header=stamps.header(STAMP_NS, FRAME))
    layout = radar(**{f"{what}_field": name for what, name in fields.items()})
    report = adapter.from_msg(message, layout)
    with_fields = adapter.from_msg(
        point_cloud.encode(
            STAMP_NS,
            FRAME,
            {name: np.zeros(0) for name in ("range", "azimuth", "amplitude", *fields.values())},
        ),
        layout,
    )
    assert report.stamp_ns == STAMP_NS
    assert len(report.detections) == 0
    assert report.anomalies == with_fields.anomalies
    assert not report.dropped


def test_names_are_recognised_in_other_letter_cases():
    message = point_cloud.encode(
        STAMP_NS,
        FRAME,
        {"Range": np.array([100.0]), "AZIMUTH": np.array([0.5]), "Amplitude": np.array([3.0])},
    )
    found = adapter.from_msg(message, radar()).detections
    assert_allclose(found.measurement, [[100.0, 0.5]])
    assert_allclose(found.amplitude, [3.0])  # An envelope as before, and no decibels


def test_from_msg_takes_a_cloud_without_a_frame_to_be_in_that_of_its_radar():
    assert len(adapter.from_msg(polar(GOOD, frame=""), radar()).detections) == 2


@pytest.mark.parametrize("frame", ["radar_2", "map", "/radar_1"])
def test_from_msg_rejects_another_frame(frame):
    with pytest.raises(RejectedMessageError) as caught:
        adapter.from_msg(polar(GOOD, frame=frame), radar())
    assert caught.value.reason == "frame"
    assert str(caught.value) == f"frame_id {frame!r}, must be 'radar_1'"


@pytest.mark.parametrize("frame", ["x" * 10**6, "\x1b[31m" * 10**5, "\n" * 10**6])
def test_from_msg_quotes_little_of_a_long_frame(frame):
    with pytest.raises(RejectedMessageError) as caught:
        adapter.from_msg(polar(GOOD, frame=frame), radar())
    text = str(caught.value)
    assert len(text) < 300
    assert text.isprintable()
    assert text.startswith(f"frame_id '{repr(frame[:10])[1:-1]}")
    assert text.endswith("', must be 'radar_1'")


@pytest.mark.parametrize("missing", ["range", "azimuth"])
def test_from_msg_rejects_a_cloud_without_a_coordinate(missing):
    names = [name for name in ("range", "azimuth", "amplitude") if name != missing]
    with pytest.raises(RejectedMessageError, match=f"field '{missing}' is missing") as caught:
        adapter.from_msg(polar([(1.0, 1.0)], names=names), radar())
    assert caught.value.reason == "schema"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ((NAN, 0.1, 4.0), "not_finite"),
        ((INF, 0.1, 4.0), "not_finite"),
        ((-INF, 0.1, 4.0), "not_finite"),
        ((1e3, NAN, 4.0), "not_finite"),
        ((1e3, INF, 4.0), "not_finite"),
        ((1e3, -INF, 4.0), "not_finite"),
        ((1e3, 0.1, -INF), "not_finite"),
        ((1e3, 0.1, INF), "amplitude"),
        ((-1.0, 0.1, 4.0), "range"),
        ((17000.1, 0.1, 4.0), "range"),
        ((1e3, 0.1, -0.5), "amplitude"),
        ((1e3, 0.1, 1.1e6), "amplitude"),
        ((1e3, 1e30, 4.0), "azimuth"),
        ((1e3, -1e300, 4.0), "azimuth"),
        ((1e3, 6300.0, 4.0), "azimuth"),
    ],
)
def test_from_msg_drops_a_bad_point_counts_it_and_keeps_the_others(bad, reason):
    report = read([GOOD[0], bad, GOOD[1]])
    assert report.dropped == {reason: 1}
    assert_array_equal(report.detections.measurement, [[1000.0, 0.5], [2000.0, -0.5]])
    assert_array_equal(report.detections.amplitude, [4.0, 8.0])


def test_from_msg_counts_dropped_points_and_keeps_those_on_the_bounds():
    report = read(
        [(NAN, NAN, NAN), (NAN, 0.0, NAN), (-1.0, 0.0, -1.0), (-2.0, 0.0, 1.0), (1.0, 0.0, -1.0)]
    )
    assert report.dropped == {"padding": 1, "not_finite": 1, "range": 2, "amplitude": 1}
    assert len(report.detections) == 0
    report = read([(0.0, 0.1, 4.0), (17e3, 0.0, 0.0), (1.0, 0.0, 1e6)])
    assert len(report.detections) == 3
    assert not report.dropped


@settings(deadline=None)
@given(st.floats(-3.14, 3.14), st.integers(-3, 3))
def test_from_msg_wraps_an_azimuth_that_is_whole_turns_off(azimuth, turns):
    report = read([(1e3, azimuth + turns * 2.0 * np.pi, 4.0)])
    assert_allclose(report.detections.measurement[0, 1], azimuth, rtol=0.0, atol=1e-14)


@settings(deadline=None)
@example(np.nextafter(np.pi, 4.0), False)
@example(4.0 * np.pi + np.pi, False)
@example(-np.pi, False)
@given(st.floats(-6000.0, 6000.0), st.booleans())
def test_from_msg_azimuths_are_above_minus_pi_and_at_most_pi(azimuth, compass):
    (found,) = read([(1e3, azimuth, 4.0)], compass=compass).detections.measurement[:, 1]
    assert -np.pi < found <= np.pi


def test_from_msg_counts_azimuths_beyond_a_revolution_that_probably_are_degrees():
    points = [(1e3, azimuth, 4.0) for azimuth in (-359.0, -6.3, -6.2, 0.0, 6.2, 6.3, 359.0)]
    assert read(points).anomalies == {"azimuths_beyond_a_turn": 4}
    assert not read(points, azimuth_in_degrees=True).anomalies


@pytest.mark.parametrize("in_degrees", [False, True])
@pytest.mark.parametrize(
    ("turn", "unit"),
    [
        *((360, "beyond_a_turn"), (400, "in_gradians"), (6400, "in_mils")),
        *((4096, "no_angles"), (65536, "no_angles")),
    ],
)
def test_units_of_azimuths_are_named_by_the_size_of_a_turn(turn, unit, in_degrees):
    rng, counts = np.random.default_rng(turn), Counter()
    for _ in range(60):
        points = [(3e3, azimuth, 4.0) for azimuth in turn * rng.random(5)]
        counts += read(points, azimuth_in_degrees=in_degrees).anomalies
    found = {*anomalies.likely(counts)}
    # Some clouds alone could be of degrees.
    found -= {"azimuths_beyond_a_turn"} if unit == "no_angles" else set()
    assert found == (set() if in_degrees and turn == 360 else {f"azimuths_{unit}"})


@pytest.mark.parametrize("azimuth_in_degrees", [False, True])
def test_from_msg_counts_ranges_and_azimuths_that_are_swapped(azimuth_in_degrees):
    points = [(azimuth, 1e3, 4.0) for azimuth in (-3.0, -1.0, 2.0)]
    report = read(
        [*points, (1.0, 1e30, 4.0), (1.0, INF, 4.0)], azimuth_in_degrees=azimuth_in_degrees
    )
    assert report.anomalies == {"fields_swapped": 4}
    assert report.dropped == {"range": 2, "azimuth": 1, "not_finite": 1}
    (text,) = anomalies.of(radar(azimuth_in_degrees=azimuth_in_degrees), report.anomalies)
    assert "are radar_1.fields.range and fields.azimuth swapped?" in text


def test_from_msg_takes_no_fields_for_swapped_whose_ranges_cannot_be_angles():
    # Mils, 6400 a turn, and a range of the wrong sign.
    report = read([(1e3, 6399.0, 4.0), (2e4, 800.0, 4.0), (-5e3, 10.0, 4.0), (3e3, 1.0, 4.0)])
    assert report.anomalies == {
        "azimuths_in_mils": 1,
        "azimuths_no_angles": 1,
        "ranges_negative": 1,
    }
    texts = [*anomalies.of(radar(), report.anomalies)]
    assert "mils" in texts[0]
    assert not any("swapped" in text for text in texts)


@pytest.mark.parametrize("unknown", [0.0, -1.0, -999.0, 9999.0])
def test_from_msg_takes_points_of_one_impossible_number_for_padding(unknown):
    points = [(1e3, 0.5, 4.0), *[(unknown, unknown, 0.0)] * 3]
    report = read(points)
    assert len(report.detections) == 1
    assert report.dropped == {"padding": 3}
    assert not report.anomalies


def test_from_msg_keeps_detections_whose_range_and_azimuth_are_equal_by_chance():
    assert len(read([(2.0, 2.0, 4.0), (400.0, 400.0, 4.0)]).detections) == 2


@pytest.mark.parametrize("compass", [False, True])
def test_from_msg_counts_no_azimuth_of_one_revolution_whatever_its_rounding(compass):
    points = [(1e3, azimuth, 4.0) for azimuth in (0.0, np.pi, 2.0 * np.pi, np.nextafter(0.0, -1.0))]
    report = adapter.from_msg(polar(points), radar(compass=compass))
    assert not report.anomalies
    assert len(report.detections) == 4


@pytest.mark.parametrize(
    ("degrees", "compass", "expected"),
    [
        *((90.0, False, 90.0), (270.0, False, -90.0), (-450.0, False, -90.0)),
        *((0.0, True, 90.0), (90.0, True, 0.0), (180.0, True, -90.0)),
        *((270.0, True, 180.0), (300.0, True, 150.0), (359.0, True, 91.0)),
    ],
)
def test_from_msg_reads_azimuths_in_degrees_and_of_a_compass(degrees, compass, expected):
    for azimuth, in_degrees in ((degrees, True), (np.radians(degrees), False)):
        report = read([(1e3, azimuth, 4.0)], azimuth_in_degrees=in_degrees, compass=compass)
        assert_allclose(report.detections.measurement[0, 1], np.radians(expected), atol=1e-12)


@pytest.mark.parametrize(
    ("level", "in_db", "offset_db", "expected"),
    [
        *((db, True, 0.0, np.sqrt(2.0 * 10.0 ** (db / 10.0))) for db in (-20.0, 0.0, 13.0, 45.0)),
        (30.0, True, -17.0, np.sqrt(2.0 * 10.0**1.3)),
        (4.0, False, 20.0, 40.0),
    ],
)
def test_from_msg_turns_levels_into_an_envelope(level, in_db, offset_db, expected):
    report = read([(1e3, 0.0, level)], amplitude_in_db=in_db, amplitude_offset_db=offset_db)
    assert_allclose(report.detections.amplitude, [expected], rtol=1e-12)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("level", [4000.0, 1e300, 120.0, INF, -INF])
def test_from_msg_drops_an_absurd_level(level):
    report = read([GOOD[0], (1e3, 0.0, level)], amplitude_in_db=True)
    assert report.dropped == {"not_finite" if level == -INF else "amplitude": 1}
    assert report.detections.measurement.tolist() == [[1000.0, 0.5]]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("in_db", [False, True])
def test_from_msg_keeps_a_detection_whose_amplitude_is_unknown(in_db):
    report = read([GOOD[0], (1e3, 0.0, NAN)], amplitude_in_db=in_db)
    assert not report.dropped
    assert np.isnan(report.detections.amplitude).tolist() == [False, True]


@pytest.mark.parametrize("amplitude_field", ["amplitude", "snr", ""])
def test_from_msg_without_an_amplitude_field_has_no_amplitudes(amplitude_field):
    message = cloud([("range", F4), ("azimuth", F4), ("power", F4)], [*GOOD, (NAN, 0.0, 1.0)])
    report = adapter.from_msg(message, radar(amplitude_field=amplitude_field))
    assert report.detections.amplitude is None
    assert len(report.detections) == 2
    assert report.dropped == {"not_finite": 1}


def test_from_msg_takes_no_field_that_is_not_named_for_it():
    message = polar(GOOD, names=("range", "azimuth", ""))
    assert adapter.from_msg(message, radar(amplitude_field="")).detections.amplitude is None
    layout = radar(range_field="rho", time_field="r")
    message = adapter.to_msg(detections(), STAMP_NS, FRAME, layout)
    found = adapter.from_msg(message, radar(time_field="r")).detections
    named = adapter.from_msg(message, layout).detections
    assert_array_equal(found.measurement, named.measurement)


@pytest.mark.parametrize("datatype", [PointField.INT8, PointField.UINT16, PointField.INT32])
def test_from_msg_reads_levels_in_whole_decibels(datatype):
    message = cloud([("range", F4), ("azimuth", F4), ("rcs", datatype)], [(1e3, 0.0, 20)])
    report = adapter.from_msg(message, radar(amplitude_field="rcs", amplitude_in_db=True))
    assert_allclose(report.detections.amplitude, [np.sqrt(200.0)], rtol=1e-12)


def test_from_msg_rejects_wrong_types_and_missing_elevations():
    message = cloud([("range", PointField.INT32), ("azimuth", F4)], [(1000, 0.0)])
    with pytest.raises(RejectedMessageError, match="'range' has type i4"):
        adapter.from_msg(message, radar(amplitude_field=""))
    with pytest.raises(RejectedMessageError, match="field 'elevation' is missing"):
        adapter.from_msg(polar(GOOD), radar(elevation_field="elevation"))


def spherical(points):
    return cloud([(name, F8) for name in ("range", "azimuth", "elevation")], points)


def test_from_msg_takes_slant_ranges_to_the_ground_where_asked():
    message = spherical([(1000.0, 0.5, np.radians(60.0)), (1000.0, 0.5, np.radians(-60.0))])
    report = adapter.from_msg(message, radar(amplitude_field="", elevation_field="elevation"))
    assert_allclose(report.detections.measurement, [[500.0, 0.5], [500.0, 0.5]], rtol=1e-12)
    message = spherical([(1000.0, 0.5, np.radians(60.0))])
    report = adapter.from_msg(message, radar(amplitude_field=""))
    assert_array_equal(report.detections.measurement, [[1000.0, 0.5]])
    far = 17000.0 / np.cos(np.radians(10.0))
    message = spherical(
        [(0.999 * far, 0.0, np.radians(10.0)), (1.001 * far, 0.0, np.radians(10.0))]
    )
    report = adapter.from_msg(message, radar(amplitude_field="", elevation_field="elevation"))
    assert report.dropped == {"range": 1}
    assert len(report.detections) == 1


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ((1e3, 0.0, NAN), "not_finite"),
        ((1e3, 0.0, INF), "not_finite"),
        ((1e3, 0.0, 2.0), "range"),
        ((-1e3, 0.0, np.pi), "range"),
    ],
)
def test_from_msg_drops_an_impossible_elevation(bad, reason):
    report = adapter.from_msg(
        spherical([bad]), radar(amplitude_field="", elevation_field="elevation")
    )
    assert report.dropped == {reason: 1}


@pytest.mark.parametrize(("sec", "nanosec"), [(-1, 0), (-(2**31), 5), (5, 10**9), (5, 2**32 - 1)])
def test_from_msg_rejects_impossible_stamps(sec, nanosec):
    message = adapter.to_msg(Detections(np.zeros((0, 2)), np.zeros(0)), 1, FRAME)
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    with pytest.raises(RejectedMessageError, match="stamp") as error:
        adapter.from_msg(message, radar())
    assert error.value.reason == "schema"


@pytest.mark.parametrize(
    "names",
    [("rho", "theta", "snr"), ("Distance", "azimuth_angle", "SNR_dB"), ("range", "az", "snr")],
)
def test_from_msg_recognises_fields_by_their_usual_names(names):
    sent = {"range_field": names[0], "azimuth_field": names[1], "amplitude_field": names[2]}
    layout = radar(**sent, amplitude_in_db=True)
    message = adapter.to_msg(detections(), STAMP_NS, FRAME, layout)
    found, named = adapter.from_msg(message, radar()), adapter.from_msg(message, layout)
    assert_array_equal(found.detections.measurement, named.detections.measurement)
    assert_array_equal(found.detections.amplitude, named.detections.amplitude)
    assert len(found.detections) > 1
