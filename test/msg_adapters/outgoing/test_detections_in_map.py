from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud, stamps
from msg_adapters.outgoing import detections_in_map
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.types import Detections, Scan

NAMES = ("x", "y", "z", "amplitude", "radar_index")
FIRST, SECOND = resolve({}).model.radars
# Half a turn and a quarter, so that axes cannot be confused.
RADARS = (replace(FIRST, yaw=np.pi), replace(SECOND, position=(0.0, 50.0), yaw=np.pi / 2.0))
STAMP_NS = 1_700_000_000_123_456_789
HITS = Detections(np.array([[100.0, 0.0], [200.0, np.pi / 2.0]]), np.array([4.0, 30.0]))
SILENT = Detections(np.zeros((0, 2)), np.zeros(0))


def cloud_of(*reports):
    data = detections_in_map.to_cdr(Scan(STAMP_NS, reports), RADARS, "site")
    return deserialize_message(data, PointCloud2)


def columns(cloud):
    kinds = dict.fromkeys(NAMES[:-1], point_cloud.FLOATS)
    return point_cloud.decode(cloud, {**kinds, NAMES[-1]: point_cloud.UNSIGNED})


def test_to_cdr_has_all_radars_detections_in_the_world_frame():
    cloud = cloud_of(HITS, Detections(np.array([[10.0, 0.0]]), np.array([7.0])))
    found = columns(cloud)
    assert (cloud.header.frame_id, stamps.to_ns(cloud.header.stamp)) == ("site", STAMP_NS)
    assert tuple(field.name for field in cloud.fields) == NAMES
    np.testing.assert_allclose(found["x"], [900.0, 1000.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(found["y"], [0.0, -200.0, 60.0], atol=1e-4)
    np.testing.assert_array_equal(found["amplitude"], [4.0, 30.0, 7.0])
    np.testing.assert_array_equal(found["radar_index"], [0, 0, 1])


def test_to_cdr_has_zeros_for_unknown_amplitudes_and_known_heights():
    found = columns(cloud_of(HITS, Detections(np.array([[10.0, 0.0]]), None)))
    np.testing.assert_array_equal(found["amplitude"], [4.0, 30.0, 0.0])
    high = replace(HITS, height=np.array([3048.0, np.nan]))
    assert columns(cloud_of(high, HITS))["z"].tolist() == [3048.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("reports", [(None, None), (SILENT, None), (SILENT, SILENT)])
def test_to_cdr_of_nothing_is_an_empty_cloud(reports):
    cloud = cloud_of(*reports)
    assert (cloud.width, cloud.height) == (0, 1)
    assert tuple(field.name for field in cloud.fields) == NAMES


def test_to_cdr_leaves_out_a_radar_that_did_not_report():
    assert columns(cloud_of(None, HITS))["radar_index"].tolist() == [1, 1]
