import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from samples import FRAME, STAMP_NS, cloud, radar
from sensor_msgs.msg import PointField

from msg_adapters.encoding import RejectedMessageError
from msg_adapters.incoming import detections as adapter
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.core.intake.sectors import coverage_of
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD, Air, HeightPrior
from phd_jdtc_ros.core.types import Detections

F4, F8, U1, I4 = (PointField.FLOAT32, PointField.FLOAT64, PointField.UINT8, PointField.INT32)
INF, NAN = np.inf, np.nan
STDS = {"range_std_field": "dr", "azimuth_std_field": "da"}
LAYOUTS = {
    "relative": {"time_field": "t"},
    "milliseconds": {"time_field": "t", "time_unit": "ms"},
    "epoch": {"time_field": "t", "time_since_epoch": True},
    "epoch_ns": {"time_field": "t", "time_since_epoch": True, "time_unit": "ns"},
    "height": {"height_field": "h", "position": (0.0, 0.0, 120.0)},
    "deviations": {"range_std_field": "dr", "azimuth_std_field": "da", "azimuth_in_degrees": True},
    "rates": {"range_rate_field": "rr", "range_rate_std_field": "sd"},
    "sectors": {"sector_field": "s", "rotation_s": 4.0, "sectors": 16},
    "sectors_compass": {"sector_field": "s", "rotation_s": 4.0, "sectors": 7, "compass": True},
}
RATES = {"range_rate_field": "rr", "range_rate_std_field": "sd"}
NAME = "detection_probability"


def read(extra, points, datatype=F8, **changes):
    """Return the report of points of range, azimuth and further columns."""
    names = [("range", F8), ("azimuth", F8), *((name, datatype) for name in extra)]
    return adapter.from_msg(cloud(names, points), radar(amplitude_field="", **changes))


def timed(*times, datatype=F8, **changes):
    points = [(1000.0 + k, 0.1, value) for k, value in enumerate(times)]
    return read(["time"], points, datatype, time_field="time", **changes)


@pytest.mark.parametrize(("unit", "scale"), [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize("datatype", [F4, F8])
def test_times_relative_to_the_stamp_are_read_in_their_unit(unit, scale, datatype):
    report = timed(-1.5 * scale, 0.25 * scale, time_unit=unit, datatype=datatype)
    assert_allclose(report.detections.time_s, [-1.5, 0.25], rtol=1e-12)
    assert not report.dropped
    assert not report.anomalies


@pytest.mark.parametrize(("unit", "scale"), [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_times_since_the_epoch_are_exact_to_a_microsecond(unit, scale):
    expected = np.array([-3.999871, 0.0, 1e-6, 0.7311113])
    seconds, nanoseconds = divmod(STAMP_NS, 10**9)
    # The sums are of whole numbers, so that only the last step rounds.
    sent = [
        float((seconds * 10**9 + nanoseconds + round(t * 1e9)) * scale / 10**9) for t in expected
    ]
    found = timed(*sent, time_unit=unit, time_since_epoch=True).detections.time_s
    assert_allclose(found, expected, rtol=0.0, atol=1e-6)


def test_times_may_be_a_minute_off_in_any_order_and_precise():
    with pytest.raises(RejectedMessageError, match="'time' has type f4") as caught:
        timed(1.7e9, datatype=F4, time_since_epoch=True)
    assert caught.value.reason == "schema"
    assert timed(-60.0, 60.0, 60.01).dropped == {"time": 1}
    assert timed(0.5, -0.5, 0.25).detections.time_s.tolist() == [0.5, -0.5, 0.25]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bad", [NAN, INF, -INF, 6.01, -6.01, 1e300])
def test_a_time_beyond_the_revolution_drops_its_detection(bad):
    report = timed(0.0, bad, 5.99, rotation_s=4.0)
    assert report.dropped == {"time": 1}
    assert report.detections.time_s.tolist() == [0.0, 5.99]
    assert report.detections.measurement[:, 0].tolist() == [1000.0, 1002.0]


@pytest.mark.parametrize("unknown", [2**32 - 1, 2**32])
def test_an_unknown_sector_is_no_anomaly(unknown):
    points = [(1000.0, 0.5, unknown), (1001.0, 0.5, unknown)]
    report = read(["s"], points, **LAYOUTS["sectors"])
    assert report.sector is None
    assert not report.anomalies


@pytest.mark.parametrize(
    ("parameter", "anomaly"),
    [
        ("time_field", "time_missing"),
        ("sector_field", "sector_missing"),
        ("height_field", "height_missing"),
        ("range_std_field", "range_std_missing"),
        ("azimuth_std_field", "azimuth_std_missing"),
        ("range_rate_field", "range_rate_missing"),
        ("range_rate_std_field", "range_rate_std_missing"),
        ("code_field", "code_missing"),
        ("address_field", "address_missing"),
        ("detection_type_field", "detection_type_missing"),
    ],
)
def test_a_field_that_is_configured_and_missing_is_an_anomaly(parameter, anomaly):
    report = read([], [(1000.0, 0.5)], **{parameter: "gone"})
    assert report.anomalies == {anomaly: 1}
    found = report.detections
    assert found.time_s is found.noise_std is found.range_rate is found.range_rate_std is None
    assert found.height is found.code is found.address is found.detection_type is None
    assert report.detections.measurement.tolist() == [[1000.0, 0.5]]


def test_a_field_of_another_type_rejects_and_empty_clouds_have_no_sector():
    with pytest.raises(RejectedMessageError, match="'time' has type i4"):
        read(["time"], [(1.0, 0.0, 3)], I4, time_field="time")
    report = read(["sector"], [], sector_field="sector", rotation_s=4.0, sectors=16)
    assert report.sector is None
    assert not report.anomalies


@pytest.mark.parametrize("datatype", [U1, I4, F4, F8])
def test_the_sector_is_one_number_of_any_type(datatype):
    points = [(1000.0, 0.1, 3), (1200.0, 0.2, 3)]
    report = read(["sector"], points, datatype, sector_field="sector", rotation_s=4.0, sectors=16)
    assert report.sector == 3
    assert not report.anomalies


@pytest.mark.parametrize("values", [(3, 4), (16, 16), (-1, -1), (2.5, 2.5), (NAN, NAN), (1e300, 0)])
def test_a_sector_that_makes_no_sense_is_a_doubt(values):
    points = [(1000.0, 0.1, values[0]), (1200.0, 0.2, values[1])]
    report = read(["sector"], points, sector_field="sector", rotation_s=4.0, sectors=16)
    assert report.sector is None
    assert report.anomalies == {"sectors_unusable": 1}
    assert len(report.detections) == 2


def high(*heights, distance=5000.0, antenna=0.0, **changes):
    points = [(distance, 0.1, value) for value in heights]
    return read(["height"], points, height_field="height", position=(0.0, 0.0, antenna), **changes)


def test_heights_or_elevations_take_slant_ranges_to_the_ground():
    report = high(3100.0, -3900.0, 100.0, antenna=100.0)
    assert_allclose(report.detections.measurement[:, 0], [4000.0, 3000.0, 5000.0], rtol=1e-12)
    assert not report.dropped
    assert high(30_001.0, distance=1e5, max_range=2e5).dropped == {"height": 1}
    assert not high(29_999.0, distance=1e5, max_range=2e5).dropped
    points = [(5000.0, 0.1, NAN, np.radians(60.0)), (5000.0, 0.1, 3000.0, np.radians(60.0))]
    names = [("range", F8), ("azimuth", F8), ("height", F8), ("elevation", F8)]
    layout = radar(amplitude_field="", height_field="height", elevation_field="elevation")
    report = adapter.from_msg(cloud(names, points), layout)
    assert_allclose(report.detections.measurement[:, 0], [2500.0, 4000.0], rtol=1e-12)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bad", [5000.1, -5000.1, 1e9, -1e9, 1e300, 30_001.0])
def test_a_height_that_is_not_possible_drops_its_detection(bad):
    report = high(0.0, bad)
    assert report.dropped == {"height": 1}
    assert len(report.detections) == 1


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("unknown", [NAN, INF, -INF])
def test_without_a_height_the_slant_range_is_used_and_that_is_a_doubt(unknown):
    report = high(3000.0, unknown)
    assert_allclose(report.detections.measurement[:, 0], [4000.0, 5000.0])
    assert not report.dropped
    assert report.anomalies == {"heights_unknown": 1}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bad", [-1.0, INF, 1e300])
def test_an_impossible_slant_range_is_no_matter_of_the_height(bad):
    reason = "range" if np.isfinite(bad) else "not_finite"
    assert high(100.0, distance=bad).dropped == {reason: 1}


def test_deviations_of_each_detection_are_read_where_known():
    points = [(1000.0, 10.0, 6.0, 0.02), (2000.0, 20.0, 7.0, 0.03)]
    report = read(["dr", "da"], points, azimuth_in_degrees=True, **STDS)
    assert_allclose(report.detections.noise_std, [[6.0, np.radians(0.02)], [7.0, np.radians(0.03)]])
    report = read(["dr"], [(1000.0, 0.1, NAN), (1000.0, 0.1, 5.0)], range_std_field="dr")
    assert_array_equal(report.detections.noise_std, [[NAN, NAN], [5.0, NAN]])
    assert not report.anomalies
    all_unknown = read(["dr"], [(1000.0, 0.1, NAN)], range_std_field="dr")
    assert all_unknown.detections.noise_std is None


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bad", [0.0, -1.0, INF, 1e6, 1e-12])
def test_an_unusable_deviation_is_left_to_the_radar_and_a_doubt(bad):
    report = read(["dr", "da"], [(1000.0, 0.1, bad, bad), (1000.0, 0.1, 5.0, 0.01)], **STDS)
    assert_array_equal(report.detections.noise_std, [[NAN, NAN], [5.0, 0.01]])
    assert report.anomalies == {"deviations_unusable": 2}
    assert not report.dropped


@pytest.mark.parametrize("changes", LAYOUTS.values(), ids=LAYOUTS)
def test_to_msg_writes_what_from_msg_reads(changes):
    layout = radar(amplitude_field="", **changes)
    given = Detections(
        np.array([[1000.0, 0.3], [16e3, 0.35]]),
        None,
        time_s=np.array([-1.2345678, 0.25]),
        noise_std=np.array([[6.0, np.nan], [np.nan, 0.001]]),
        range_rate=np.array([-3.5, np.nan]),
        range_rate_std=np.array([0.25, np.nan]),
        coverage=coverage_of(3, layout.sectors or 8, layout.units.compass),
    )
    report = adapter.from_msg(adapter.to_msg(given, STAMP_NS, FRAME, layout), layout)
    assert not report.dropped
    assert not report.anomalies
    assert_allclose(report.detections.measurement, given.measurement, atol=1e-3)
    if layout.fields.time:
        assert_allclose(report.detections.time_s, given.time_s, rtol=0.0, atol=1e-6)
    if layout.fields.range_std:
        assert_allclose(report.detections.noise_std, given.noise_std, rtol=1e-6)
    if layout.fields.range_rate:
        lacking = adapter.to_msg(replace(given, range_rate=None), STAMP_NS, FRAME, layout)
        assert_array_equal(adapter.from_msg(lacking, layout).detections.range_rate, [NAN, NAN])
        assert_array_equal(report.detections.range_rate, given.range_rate)
        assert_array_equal(report.detections.range_rate_std, given.range_rate_std)
    if layout.fields.sector:
        assert report.sector == 3


def test_to_msg_refuses_detections_without_a_sector():
    layout = radar(amplitude_field="", sector_field="s", rotation_s=4.0, sectors=16)
    with pytest.raises(ValueError, match="coverage: None given"):
        adapter.to_msg(Detections(np.zeros((1, 2)), None), 0, FRAME, layout)


def test_range_rates_are_read_and_doubted_beyond_the_ambiguity():
    points = [(1000.0, 0.1, -7.5, 0.2), (2000.0, 0.2, NAN, NAN)]
    report = read(["rr", "sd"], points, **RATES)
    assert_array_equal(report.detections.range_rate, [-7.5, NAN])
    assert_array_equal(report.detections.range_rate_std, [0.2, NAN])
    assert not report.anomalies
    assert not report.dropped
    points = [(1000.0, 0.1, value) for value in (29.9, -15.0, 30.0, 30.1, -45.0, NAN)]
    settings = {"range_rate_field": "rr", "range_rate_ambiguity": 30.0}
    report = read(["rr"], points, **settings)
    assert_array_equal(report.detections.range_rate, [29.9, -15.0, 30.0, 30.1, -45.0, NAN])
    assert report.anomalies == {"range_rates_beyond_ambiguity": 2}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bad", [INF, -INF, 1e30, -6e3])
def test_a_detection_with_an_impossible_range_rate_is_kept_without_it(bad):
    report = read(["rr"], [(1000.0, 0.1, bad), (1000.0, 0.1, 5.0)], range_rate_field="rr")
    assert_array_equal(report.detections.range_rate, [NAN, 5.0])
    assert report.anomalies == {"range_rates_unusable": 1}
    assert not report.dropped


@pytest.mark.parametrize("bad", [0.0, -1.0, INF, 1e6])
def test_an_unusable_deviation_of_a_range_rate_is_a_doubt(bad):
    report = read(["rr", "sd"], [(1000.0, 0.1, 1.0, bad)], **RATES)
    assert_array_equal(report.detections.range_rate_std, [NAN])
    assert report.anomalies == {"deviations_unusable": 1}


def test_detections_out_of_the_range_limits_are_dropped_and_counted():
    points = [(599.0, 0.1), (600.0, 0.1), (9e3, 0.1), (9001.0, 0.1)]
    report = read([], points, min_range=600.0, max_range=9e3)
    assert report.detections.measurement[:, 0].tolist() == [600.0, 9e3]
    assert report.dropped == {"range": 2}


def detection(found, std=0.02):
    return {NAME: found, f"{NAME}_std": std, f"{NAME}_set": 0.9}


def noise(ratio, std=0.02):
    return {"range_noise_ratio": ratio, "range_noise_ratio_std": std}


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        (detection(0.5), "it detects targets with probability 0.50 instead of 0.90"),
        (noise(2.0), "its range noise is 2 times the configured one"),
    ],
)
def test_radar_that_is_worse_than_set_gives_a_warning_with_the_numbers(figures, said):
    assert said in anomalies.of_learned(figures)


@pytest.mark.parametrize(
    "figures",
    [{}, detection(0.85), detection(0.5, std=0.2), noise(1.2), noise(0.5), noise(2.0, std=0.5)],
)
def test_radar_that_is_as_set_or_not_known_well_gives_none(figures):
    assert anomalies.of_learned(figures) is None


@pytest.mark.parametrize("figures", [detection(0.72), detection(0.5, std=0.2), noise(1.4)])
def test_warning_stays_until_the_radar_is_clearly_better(figures):
    assert anomalies.of_learned(figures) is None
    assert anomalies.of_learned(figures, warned=True) is not None


@pytest.mark.parametrize("figures", [{}, detection(0.8), noise(1.2)])
def test_warning_ends_when_the_radar_is_clearly_better(figures):
    assert anomalies.of_learned(figures, warned=True) is None


def test_figures_of_a_radar_are_not_those_of_others():
    figures = {"radar.range_noisier": 1.0, "radar_2.range_noisier": 2.0, "hypotheses": 3.0}
    assert anomalies.figures_of("radar", figures) == {"range_noisier": 1.0}


def test_an_anomaly_that_only_its_decoder_knows_is_named():
    assert list(anomalies.of(None, {"positions_implausible": 3})) == ["3 positions implausible"]


@pytest.mark.parametrize(("field", "named"), [("", "sectors"), ("t", "fields.time")])
def test_an_unclear_antenna_is_explained_by_what_the_radar_has(field, named):
    (text,) = anomalies.of(radar(time_field=field), {"antenna_unclear": 3})
    assert text.endswith(f"are radar_1.rotation_s and {named} right?")


def in_space(points, extra=(), **changes):
    """Return the report of points of range, azimuth, elevation and more to a radar in space."""
    names = [(name, F8) for name in ("range", "azimuth", "el", *extra)]
    given = radar(amplitude_field="", elevation_field="el", **changes)
    spatial = given.in_space(HeightPrior(0.0, 5e3, 0.0), Air())
    return adapter.from_msg(cloud(names, points), spatial)


def test_slant_ranges_and_elevations_are_measurements_in_space():
    points = [(1000.0, 0.1, 0.5), (2000.0, 3.5, -0.02)]
    found = in_space(points, max_range=1999.0, min_range=900.0)
    assert_allclose(found.detections.measurement, [[1000.0, 0.1, 0.5]])
    assert found.dropped == {"range": 1}  # They are slant ranges
    assert found.detections.noise_std is None
    both = in_space(points).detections.measurement
    assert_allclose(both[1], [2000.0, 3.5 - 2.0 * np.pi, -0.02])
    # In the plane the same elevation flattens the range.
    flat = read(["el"], [(1000.0, 0.1, 0.5)], elevation_field="el").detections.measurement
    assert_allclose(flat, [[1000.0 * np.cos(0.5), 0.1]])


@pytest.mark.parametrize(("bad", "unusable"), [(NAN, 0), (INF, 1), (40.0, 1), (-1.58, 1)])
def test_detection_with_an_impossible_elevation_is_kept_without_it(bad, unusable):
    found = in_space([(1000.0, 0.1, 0.5), (1500.0, 0.2, bad)])
    assert not found.dropped
    assert found.anomalies["elevations_unusable"] == unusable
    assert_allclose(found.detections.measurement, [[1000.0, 0.1, 0.5], [1500.0, 0.2, 0.0]])
    assert_allclose(found.detections.noise_std, [[NAN] * 3, [NAN, NAN, UNKNOWN_STD]])
    if unusable:
        (said,) = anomalies.of(radar(), found.anomalies)
        assert "radar_1.units.elevation to deg or mrad" in said


@pytest.mark.parametrize(
    ("unit", "sent", "std"),
    [
        ("rad", 0.5, 0.01),
        ("deg", math.degrees(0.5), math.degrees(0.01)),
        ("mrad", 500.0, 10.0),
        ("down_rad", -0.5, 0.01),
        ("down_deg", -math.degrees(0.5), math.degrees(0.01)),
        ("zenith_rad", 0.5 * math.pi - 0.5, 0.01),
        ("zenith_deg", 90.0 - math.degrees(0.5), math.degrees(0.01)),
    ],
)
def test_elevations_are_in_their_unit_and_sense(unit, sent, std):
    points = [(1000.0, 0.1, sent, std)]
    found = in_space(points, ["de"], elevation_unit=unit, elevation_std_field="de").detections
    assert_allclose(found.measurement, [[1000.0, 0.1, 0.5]], rtol=1e-7)
    assert_allclose(found.noise_std, [[NAN, NAN, 0.01]], rtol=1e-6)
    flat = read(["el"], [points[0][:3]], elevation_field="el", elevation_unit=unit)
    assert_allclose(flat.detections.measurement, [[1000.0 * np.cos(0.5), 0.1]], rtol=1e-7)


def test_elevations_with_the_wrong_sign_are_named_with_the_line_that_mends_it():
    points = [(1000.0, 0.1, 0.4), (900.0, 1.0, 0.2), (800.0, 2.0, 0.3), (700.0, 2.0, 0.01)]
    sonar = {"fov_elevation_deg": [-60.0, 0.0]}
    found = in_space(points, **sonar)
    assert found.anomalies == {"elevations_opposite": 3}
    assert len(found.detections) == 4
    (said,) = anomalies.of(radar(**sonar), found.anomalies)
    assert "radar_1.units.elevation to down_rad" in said
    assert not in_space(points, elevation_unit="down_rad", **sonar).anomalies
    # With any field of view they put the targets below the floor of heights.
    below = [(distance, azimuth, -elevation) for distance, azimuth, elevation in points]
    assert in_space(below).anomalies == {"elevations_opposite": 3}
    assert not in_space(points).anomalies


@pytest.mark.parametrize("absurd", [1e30, -np.inf])
def test_absurd_heights_leave_their_detections_in_space(absurd):
    found = in_space(
        [(1000.0, 0.1, 0.1, absurd), (900.0, 1.0, 0.2, 300.0)], ["h"], height_field="h"
    )
    assert found.anomalies == {"heights_unusable": 1}
    assert_array_equal(found.detections.z, [NAN, 300.0])


def test_deviations_of_elevations_are_each_detections_own():
    points = [(1000.0, 0.1, 0.5, 0.01), (1500.0, 0.2, NAN, 0.02), (1200.0, 0.2, 0.1, -1.0)]
    found = in_space(points, ["de"], elevation_std_field="de")
    assert_allclose(found.detections.noise_std[:, 2], [0.01, UNKNOWN_STD, NAN])
    assert found.anomalies["deviations_unusable"] == 1


def test_radar_without_elevations_measures_slant_ranges_in_space():
    spatial = radar(amplitude_field="").in_space(HeightPrior(0.0, 5e3, 0.0), Air())
    names = [(name, F8) for name in ("range", "azimuth")]
    found = adapter.from_msg(cloud(names, [(1000.0, 0.1)]), spatial).detections
    assert_allclose(found.measurement, [[1000.0, 0.1, 0.0]])
    assert_allclose(found.noise_std, [[NAN, NAN, UNKNOWN_STD]])


def test_elevations_that_are_all_zero_are_a_drivers_filling_in_space():
    for points in (
        [(1000.0, 0.1, 0.0), (1500.0, 0.2, 0.0), (900.0, 0.2, NAN)],
        [(1000.0, 0.1, NAN), (1500.0, 0.2, NAN), (900.0, 0.2, NAN)],
    ):
        found = in_space(points)
        assert (found.detections.noise_std[:, 2] == UNKNOWN_STD).all()
        assert found.anomalies == {"elevations_unknown": 3}
        (said,) = anomalies.of(radar(), found.anomalies)
        assert said.startswith("3 detections without an elevation")
        assert "radar_1.fields.elevation has to be empty" in said
    some = in_space([(1000.0, 0.1, 0.0), (1500.0, 0.2, 1e-3)])
    assert some.detections.noise_std is None
    assert not some.anomalies
