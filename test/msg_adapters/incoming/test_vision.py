"""A detector's array of objects as positions."""

import math

import numpy as np
import pytest
from message_types import Detection3D, Detection3DArray, ObjectHypothesisWithPose
from numpy.testing import assert_allclose

from msg_adapters.encoding import RejectedMessageError, stamps
from msg_adapters.incoming import vision
from msg_adapters.incoming.readers import READERS, reader_of
from phd_jdtc_ros.configuration.build import resolve

STAMP_NS = 1_000_000_000
BASE = {
    "sensors": ["lidar"],
    "lidar.kind": "position",
    "lidar.message": "detections_3d",
    "lidar.position": [0.0, 0.0, 1.5],
}


def own(state):
    (found,) = resolve({**BASE, "state": state}).inputs
    return found


def detected(place, size=4.0, hypotheses=()):
    """Return a detection; a hypothesis is a score, a place, and its variances with a covariance."""
    detection = Detection3D()
    centre = detection.bbox.center.position
    centre.x, centre.y, centre.z = place
    detection.bbox.size.x = size
    for score, at, variances, across in hypotheses:
        result = ObjectHypothesisWithPose()
        result.hypothesis.score = score
        position = result.pose.pose.position
        position.x, position.y, position.z = at
        covariance = np.zeros((6, 6))
        covariance[[0, 1, 2], [0, 1, 2]], covariance[0, 1] = variances, across
        result.pose.covariance = covariance.ravel()
        detection.results.append(result)
    return detection


def report(detections, state="space", frame="lidar"):
    message = Detection3DArray(header=stamps.header(STAMP_NS, frame))
    message.detections = list(detections)
    return vision.from_msg(message, own(state))


def test_places_are_centres_of_boxes_or_of_the_best_hypothesis_with_a_covariance():
    none = (0.0, 0.0, 0.0)
    found = report(
        [
            detected((10.0, 5.0, 1.0)),
            detected((20.0, 5.0, 1.0), hypotheses=[(0.9, (7.0, 7.0, 7.0), none, 0.0)]),
            detected(
                (30.0, 5.0, 1.0),
                hypotheses=[
                    (0.2, (1.0, 1.0, 1.0), (1.0, 1.0, 1.0), 0.0),
                    (0.7, (31.0, 6.0, 2.0), (0.04, 0.09, 0.25), 0.03),
                ],
            ),
            detected(none, 0.0, [(0.5, (40.0, 1.0, 0.0), none, 0.0)]),
        ]
    ).detections
    assert_allclose(found.measurement, [[10.0, 5.0], [20.0, 5.0], [31.0, 6.0], [40.0, 1.0]])
    assert_allclose(found.z, [2.5, 2.5, 3.5, 1.5])
    assert_allclose(found.noise_std[2], [0.2, 0.3])
    assert_allclose(found.noise_correlation[2], 0.5)
    assert_allclose(found.z_std[2], 0.5)
    assert np.isnan(found.noise_std[[0, 1, 3]]).all()


def test_in_the_plane_heights_are_not_used_and_absurd_places_are_dropped():
    found = report([detected((10.0, 5.0, 1.0)), detected((math.nan, 5.0, 1.0))], "plane")
    assert found.detections.z is None
    assert len(found.detections) == 1
    assert found.dropped == {"not_finite": 1}
    assert len(report([], "plane").detections) == 0


def test_other_frames_and_bytes_that_are_no_message_are_refused():
    with pytest.raises(RejectedMessageError) as caught:
        report([], frame="camera")
    assert caught.value.reason == "frame"
    reader = reader_of(own("plane"))
    assert reader is READERS["detections_3d"]
    with pytest.raises(RejectedMessageError, match="vision_msgs/msg/Detection3DArray"):
        reader.from_cdr(b"\x00\x01\x00\x00", own("plane"))
