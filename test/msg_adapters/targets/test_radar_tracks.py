import uuid
from dataclasses import replace

import numpy as np
import pytest
from message_types import RadarTrack, RadarTracks
from numpy.testing import assert_allclose
from samples import STAMP_NS, estimates, nothing

from msg_adapters.encoding import stamps
from msg_adapters.targets import tracks

CLASS = {
    "radar_msgs/msg/RadarTracks": RadarTracks,
    "radar_msgs/msg/RadarTrack": RadarTrack,
}.__getitem__
RUN = uuid.UUID(int=1)


@pytest.mark.parametrize("given", [estimates(), nothing()])
def test_to_msg_has_position_and_class_of_targets(given):
    message = tracks.to_radar_tracks(given, "map", RUN, CLASS)
    assert message.header.frame_id == "map"
    assert stamps.to_ns(message.header.stamp) == STAMP_NS
    for row, track in enumerate(message.tracks):
        x, vx, y, vy, _ = given.state[row]
        assert (track.position.x, track.position.y, track.position.z) == (x, y, 0.0)
        assert (track.velocity.x, track.velocity.y, track.velocity.z) == (vx, vy, 0.0)
        assert track.classification == 32000 + given.class_id[row]


def test_to_msg_orders_covariances_by_the_upper_triangle():
    given = estimates()
    for row, track in enumerate(tracks.to_radar_tracks(given, "map", RUN, CLASS).tracks):
        covariance = given.covariance[row]
        xx, xy, yy = covariance[0, 0], covariance[0, 2], covariance[2, 2]
        assert_allclose(track.position_covariance, [xx, xy, 0.0, yy, 0.0, 0.0])
        xx, xy, yy = covariance[1, 1], covariance[1, 3], covariance[3, 3]
        assert_allclose(track.velocity_covariance, [xx, xy, 0.0, yy, 0.0, 0.0])


def identifiers(given, run=RUN):
    sent = tracks.to_radar_tracks(given, "map", run, CLASS).tracks
    return [bytes(track.uuid.uuid) for track in sent]


def test_to_msg_gives_identifiers_within_a_run():
    given = replace(estimates(), track_id=np.array([7, 8, 9]))
    later = replace(given, stamp_ns=STAMP_NS + 1, track_id=np.array([9, 8, 7]))
    assert identifiers(later) == identifiers(given)[::-1]
    assert not set(identifiers(given, uuid.UUID(int=2))) & set(identifiers(given))
    given = replace(estimates(), track_id=np.zeros(3, dtype=int))
    later = replace(given, stamp_ns=STAMP_NS + 1)
    assert len({*identifiers(given), *identifiers(later)}) == 6


def test_to_msg_fits_the_installed_messages():
    pytest.importorskip("radar_msgs")
    assert len(tracks.to_radar_tracks(estimates(), "map", RUN).tracks) == 3
