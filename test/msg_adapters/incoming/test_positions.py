"""Clouds of positions: their fields, and what a sensor may send wrongly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from msg_adapters.encoding import RejectedMessageError, interfaces, names, point_cloud
from msg_adapters.incoming import recognised
from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.sensors.range_rate import VelocityModel
from phd_jdtc_ros.core.types import UNKNOWN, Detections

STAMP_NS = 10**12 + 5 * 10**8
NAN = np.nan


def sensor(**given):
    values = {f"lidar.{name}": value for name, value in given.items()}
    return resolve({"sensors": ["lidar"], "lidar.kind": "position", **values}).inputs[0]


LIDAR = sensor(area=[-100.0, -100.0, 100.0, 100.0])


def read(columns, own=LIDAR, frame="lidar", wide=()):
    """Return the report of a cloud with these columns."""
    arrays = {name: np.asarray(column) for name, column in columns.items()}
    cloud = interfaces.decode(point_cloud.to_cdr(STAMP_NS, frame, arrays, wide), names.CLOUD)
    return reader_of(own).from_msg(cloud, own)


def test_x_and_y_are_all_that_a_cloud_needs():
    report = read({"x": [1.0, -2.0], "y": [0.0, 3.0], "z": [0.5, NAN], "intensity": [7.0, 8.0]})
    assert report.stamp_ns == STAMP_NS
    assert_array_equal(report.detections.measurement, [[1.0, 0.0], [-2.0, 3.0]])
    assert not report.dropped
    assert not report.anomalies
    assert report.detections.noise_std is None
    assert report.detections.velocity is None


def test_a_target_at_the_sensor_itself_is_a_detection():
    assert len(read({"x": [0.0], "y": [0.0]}).detections) == 1


def test_zeros_that_fill_a_list_are_no_targets_at_the_sensor():
    report = read({"x": [1.0, 0.0, 0.0, 0.0], "y": [2.0, 0.0, 0.0, 0.0]})
    assert_array_equal(report.detections.measurement, [[1.0, 2.0]])
    assert report.dropped == {"padding": 3}
    assert not report.anomalies


def test_deviations_and_velocities_are_used_under_their_usual_names():
    found = read(
        {
            "x": [1.0, 2.0],
            "y": [3.0, 4.0],
            "x_std": [0.5, NAN],
            "y_std": [0.25, 1.0],
            "correlation": [0.5, 0.5],
            "vx": [3.0, NAN],
            "vy": [-4.0, 0.0],
        }
    )
    detections = found.detections
    # A covariance of which a part is unknown is unknown.
    assert_array_equal(detections.noise_std, [[0.5, 0.25], [NAN, NAN]])
    assert_array_equal(detections.noise_correlation, [0.5, NAN])
    assert_array_equal(detections.velocity, [[3.0, -4.0], [NAN, NAN]])
    assert not found.anomalies


@pytest.mark.parametrize(
    ("std", "correlation"),
    [((0.0, 1.0), 0.0), ((-1.0, 1.0), 0.0), ((1.0, 1e9), 0.0), ((1.0, 1.0), 1.0), ((1, 1), -7.0)],
)
def test_covariance_that_is_not_positive_definite_is_replaced(std, correlation):
    columns = {
        "x": [1.0, 2.0],
        "y": [1.0, 2.0],
        "x_std": [std[0], 0.5],
        "y_std": [std[1], 0.5],
        "correlation": [correlation, 0.5],
    }
    report = read({name: np.array(column, float) for name, column in columns.items()})
    assert_array_equal(report.detections.noise_std, [[NAN, NAN], [0.5, 0.5]])
    assert_array_equal(report.detections.noise_correlation, [NAN, 0.5])
    assert report.anomalies == {"deviations_unusable": 1}
    (text,) = anomalies.of(LIDAR, report.anomalies)
    assert text == (
        "1 standard deviation that is zero, negative or absurd, or covariance that is not "
        "positive definite; lidar.position_std replaces it"
    )


def test_points_that_are_no_places_of_the_area_are_dropped():
    columns = {"x": [NAN, np.inf, 101.0, 5.0], "y": [0.0, 0.0, 0.0, 6.0]}
    report = read(columns)
    assert_array_equal(report.detections.measurement, [[5.0, 6.0]])
    assert report.dropped == {"not_finite": 2, "area": 1}


def test_places_in_millions_are_used_and_noted():
    own = sensor(area=[6e6, 5e6, 7e6, 6e6], position=[-6.5e6, -5.5e6])
    report = read({"x": [6500010.0, 1e300], "y": [5500020.0, 0.0]}, own, wide=("x", "y"))
    assert_array_equal(report.detections.measurement, [[6500010.0, 5500020.0]])
    assert report.dropped == {"not_finite": 1}
    assert report.anomalies == {"positions_far": 1}
    (text,) = anomalies.of(own, report.anomalies)
    assert text.startswith("1 position 1000 km or more from the sensor, where single precision")


def test_absurd_velocities_leave_their_detections():
    report = read({"x": [1.0, 2.0], "y": [1.0, 2.0], "vx": [np.inf, 1.0], "vy": [0.0, 2.0]})
    assert_array_equal(report.detections.velocity, [[NAN, NAN], [1.0, 2.0]])
    assert report.anomalies == {"velocities_unusable": 1}


@pytest.mark.parametrize(
    ("columns", "reason", "text"),
    [
        ({"x": [1.0]}, "schema", "field 'y' is missing"),
        ({"range": [1.0], "azimuth": [0.1]}, "schema", "field 'x' is missing"),
        ({"x": np.array([1]), "y": [1.0]}, "schema", "field 'x' has type u4"),
    ],
)
def test_cloud_without_places_is_rejected(columns, reason, text):
    with pytest.raises(RejectedMessageError, match=text) as refused:
        read(columns)
    assert refused.value.reason == reason


def test_a_named_field_that_is_missing_is_an_anomaly():
    own = sensor(**{"fields.x_std": "sigma_x", "fields.time": "t", "fields.address": "id"})
    report = read({"x": [1.0], "y": [1.0], "y_std": [1.0]}, own)
    assert report.anomalies == {"x_std_missing": 1, "time_missing": 1, "address_missing": 1}
    texts = [*anomalies.of(own, report.anomalies)]
    assert "the field named by lidar.fields.x_std is missing; position_std is used" in texts


def test_a_cloud_without_points_and_fields_is_a_report_without_detections():
    message = names.CLOUD
    cloud = interfaces.installed_class(message)()
    cloud.header.frame_id = "lidar"
    cloud.header.stamp.sec = 1000
    assert len(reader_of(LIDAR).from_msg(cloud, LIDAR).detections) == 0


def test_repeated_points_count_once():
    report = read({"x": [1.0, 1.0, 1.0], "y": [2.0, 2.0, 3.0]})
    assert_array_equal(report.detections.measurement, [[1.0, 2.0], [1.0, 3.0]])
    assert report.anomalies == {"detections_repeated": 1}


def test_written_clouds_are_read_again():
    fields = {"time": "time", "amplitude": "a", "height": "h", "code": "c", "velocity_std": "v"}
    own = sensor(
        **{f"fields.{name}": value for name, value in fields.items()},
        amplitude_offset_db=3.0,
        **{"units.amplitude": "db", "units.time_reference": "epoch"},
    )
    sent = Detections(
        np.array([[1.0, 2.0], [3.0, 4.0]]),
        np.array([4.0, NAN]),
        np.array([-0.25, 0.5]),
        noise_std=np.array([[0.5, 0.25], [NAN, NAN]]),
        noise_correlation=np.array([0.5, NAN]),
        velocity=np.array([[NAN, NAN], [-1.0, 2.0]]),
        velocity_std=np.array([[NAN, NAN], [0.5, 0.5]]),
        height=np.array([NAN, 12.0]),
        code=np.array([0o1234, UNKNOWN]),
    )
    reader = reader_of(own)
    report = reader.from_cdr(reader.to_cdr(sent, STAMP_NS, own), own)
    for name in ("measurement", "amplitude", "time_s", "noise_std", "noise_correlation"):
        assert_allclose(getattr(report.detections, name), getattr(sent, name), rtol=1e-6)
    for name in ("velocity", "velocity_std", "height", "code"):
        assert_allclose(getattr(report.detections, name), getattr(sent, name), rtol=1e-6)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        (("x", "y", "z", "intensity"), True),
        (("X", "Y"), True),
        (("x", "z"), False),
        (("pos_x", "pos_y", "pos_z"), True),
        # A range and an azimuth, under any usual names, are a radar's; one alone is no place.
        (("x", "y", "z", "range", "azimuth"), False),
        (("x", "y", "rho", "Bearing"), False),
        (("x", "y", "z", "range", "ring"), True),
        (("x", "y", "angle"), True),
        (("range", "azimuth"), False),
    ],
)
def test_clouds_with_a_range_and_an_azimuth_are_of_radars(fields, expected):
    assert recognised.is_of_positions(fields) == expected


def test_z_is_a_height_in_space_and_nothing_in_the_plane():
    columns = {"x": [1.0, 2.0], "y": [3.0, 4.0], "z": [0.5, NAN], "z_std": [0.2, 0.1]}
    flat = read(columns).detections
    assert flat.z is None
    assert flat.height is None
    place = {"area": [-100.0, -100.0, 100.0, 100.0], "position": [0.0, 0.0, 4.0]}
    values = {f"lidar.{name}": value for name, value in place.items()}
    given = {"sensors": ["lidar"], "lidar.kind": "position", "state": "space", **values}
    own = resolve(given).inputs[0]
    report = read(columns, own)
    assert_array_equal(report.detections.z, [4.5, NAN])
    assert_allclose(report.detections.z_std, [0.2, 0.1], rtol=1e-6)
    assert report.anomalies == {"heights_unknown": 1}
    assert read({"x": [1.0], "y": [3.0]}, own).detections.z is None
    again = reader_of(own).from_cdr(reader_of(own).to_cdr(report.detections, STAMP_NS, own), own)
    assert_array_equal(again.detections.z, report.detections.z)


def test_climb_is_a_part_of_velocities_in_space_and_nothing_in_the_plane():
    columns = {
        "x": [1.0, 2.0, 3.0],
        "y": [3.0, 4.0, 5.0],
        "vx": [1.0, 2.0, NAN],
        "vy": [0.5, 0.5, 0.5],
        "vz": [-0.25, NAN, np.inf],
    }
    flat = read(columns)
    assert flat.detections.velocity.shape == (3, 2)
    assert not flat.anomalies
    (own,) = resolve({"sensors": ["lidar"], "lidar.kind": "position", "state": "space"}).inputs
    report = read(columns, own)
    assert_array_equal(
        report.detections.velocity, [[1.0, 0.5, -0.25], [2.0, 0.5, 0.0], [NAN, NAN, 0.0]]
    )
    unknown = VelocityModel.UNKNOWN_STD
    assert_array_equal(report.detections.velocity_std[:, 2], [NAN, unknown, unknown])
    assert report.anomalies == {"velocities_unusable": 1}
    again = reader_of(own).from_cdr(reader_of(own).to_cdr(report.detections, STAMP_NS, own), own)
    assert_array_equal(again.detections.velocity[0], report.detections.velocity[0])


def edges(*area):
    names = ("area_x_min", "area_y_min", "area_x_max", "area_y_max")
    return {name: [edge, edge] for name, edge in zip(names, area, strict=True)}


def test_a_cloud_may_have_an_area_of_its_own():
    report = read({"x": [150.0, 50.0], "y": [0.0, 0.0], **edges(120.0, -10.0, 200.0, 10.0)})
    assert report.detections.area == (120.0, -10.0, 200.0, 10.0)
    assert_array_equal(report.detections.measurement, [[150.0, 0.0]])
    assert report.dropped == {"area": 1}
    sent = reader_of(LIDAR).to_cdr(report.detections, STAMP_NS, LIDAR)
    assert reader_of(LIDAR).from_cdr(sent, LIDAR).detections.area == report.detections.area


@pytest.mark.parametrize(
    "area", [(5.0, 0.0, 5.0, 9.0), (9.0, 0.0, -9.0, 9.0), (NAN, 0.0, 9.0, 9.0), (0, 0, np.inf, 9)]
)
def test_an_area_that_is_none_is_replaced(area):
    report = read({"x": [1.0, 2.0], "y": [1.0, 2.0], **edges(*map(float, area))})
    assert report.detections.area is None
    assert len(report.detections) == 2
    (text,) = anomalies.of(LIDAR, report.anomalies)
    assert text.startswith("1 cloud whose area_x_min, area_y_min, area_x_max and area_y_max are")
    assert "lidar.area replaces it" in text
    unknown = read({"x": [1.0, 2.0], "y": [1.0, 2.0], **edges(NAN, NAN, NAN, NAN)})
    assert not unknown.anomalies


@pytest.mark.parametrize("absurd", [1e30, -1e30, np.inf, NAN])
def test_absurd_z_leaves_its_detection(absurd):
    given = {"sensors": ["lidar"], "lidar.kind": "position", "state": "space"}
    (own,) = resolve(given).inputs
    report = read({"x": [1.0, 2.0], "y": [3.0, 4.0], "z": [0.5, absurd]}, own)
    assert_array_equal(report.detections.z, [0.5, NAN])
    assert len(report.detections) == 2
    what = "heights_unknown" if np.isnan(absurd) else "heights_unusable"
    assert report.anomalies == {what: 1}


def test_places_in_millions_that_are_not_rounded_are_not_noted():
    own = sensor(area=[6e6, 5e6, 7e6, 6e6], position=[-6.5e6, -5.5e6])
    report = read({"x": [6500010.01], "y": [5500020.01]}, own, wide=("x", "y"))
    assert not report.anomalies
