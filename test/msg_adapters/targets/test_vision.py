from dataclasses import replace

import numpy as np
import pytest
from message_types import Detection3D, Detection3DArray, ObjectHypothesisWithPose
from numpy.testing import assert_allclose
from samples import STAMP_NS, estimates, nothing

from msg_adapters.encoding import stamps
from msg_adapters.targets import tracks

CLASS = {
    "vision_msgs/msg/Detection3DArray": Detection3DArray,
    "vision_msgs/msg/Detection3D": Detection3D,
    "vision_msgs/msg/ObjectHypothesisWithPose": ObjectHypothesisWithPose,
}.__getitem__
CLASSES = ("small", "large")


def test_to_msg_has_hypotheses_covariances_and_names():
    given = replace(estimates(2), class_probability=np.array([[0.25, 0.75], [0.5, 0.5]]))
    message = tracks.to_detections_3d(given, "map", CLASSES, CLASS)
    found = [
        [(result.hypothesis.class_id, result.hypothesis.score) for result in detection.results]
        for detection in message.detections
    ]
    assert found == [[("large", 0.75), ("small", 0.25)], [("small", 0.5), ("large", 0.5)]]
    given = estimates(1)
    (detection,) = tracks.to_detections_3d(given, "map", CLASSES, CLASS).detections
    matrix = np.reshape(detection.results[0].pose.covariance, (6, 6))
    assert_allclose(matrix[:2, :2], given.covariance[0][np.ix_([0, 2], [0, 2])])
    assert np.count_nonzero(matrix[2:]) == np.count_nonzero(matrix[:, 2:]) == 0
    given = replace(estimates(), track_id=np.array([0, 5, 12]))
    message = tracks.to_detections_3d(given, "map", CLASSES, CLASS)
    assert [detection.id for detection in message.detections] == ["", "5", "12"]


def test_to_msg_places_targets_facing_where_they_move():
    given = estimates(1)
    given = replace(given, state=np.array([[10.0, 0.0, -20.0, 5.0, 0.1]]))
    (detection,) = tracks.to_detections_3d(given, "map", CLASSES, CLASS).detections
    pose = detection.bbox.center
    assert (pose.position.x, pose.position.y, pose.position.z) == (10.0, -20.0, 0.0)
    half = np.sqrt(0.5)
    assert_allclose([pose.orientation.z, pose.orientation.w], [half, half])
    assert detection.results[0].pose.pose == pose


@pytest.mark.parametrize("given", [estimates(), nothing()])
def test_to_msg_stamps_the_array_and_every_detection(given):
    message = tracks.to_detections_3d(given, "map", CLASSES, CLASS)
    headers = [message.header, *(detection.header for detection in message.detections)]
    assert {header.frame_id for header in headers} == {"map"}
    assert {stamps.to_ns(header.stamp) for header in headers} == {STAMP_NS}


def test_to_msg_fits_the_installed_messages():
    pytest.importorskip("vision_msgs")
    assert len(tracks.to_detections_3d(estimates(), "map", CLASSES).detections) == 3
