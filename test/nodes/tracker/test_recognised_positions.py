"""A live tracker whose sensor is left a radar, and sends positions: people and cars."""

import numpy as np
import street
from live_radars import options, reliable
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud
from msg_adapters.targets import estimates
from phd_jdtc_ros import evaluate

TOPIC, FRAME, SEED, SCANS = "/lidar/objects", "velodyne", 74, 150


def cloud(scan, points):
    stamp_ns = round(1e9 * (1000.0 + street.TIMES[scan]))
    columns = dict(zip(("x", "y", "z"), points.T, strict=True))
    return point_cloud.encode(stamp_ns, FRAME, columns)


def test_clouds_of_positions_are_tracked_live_with_nothing_else_set(processes, peer):
    given = options(sensors="[lidar]", **{"lidar.topic": TOPIC})
    tracker = processes.start("tracker", "--ros-args", *given, *reliable(TOPIC))
    output = peer.publisher(PointCloud2, TOPIC, 400)
    found = peer.collect(PointCloud2, "/tracker/filtered/estimates", 400)
    assert peer.spin_until(lambda: output.get_subscription_count() > 0)
    clouds = street.clouds(SEED)[:SCANS]
    for scan, points in enumerate(clouds[:60]):
        output.publish(cloud(scan, points))
        peer.pace(0.02)

    def is_position():
        request = GetParameters.Request(names=["lidar.kind"])
        (value,) = peer.call(GetParameters, "/tracker/get_parameters", request).values
        return value.string_value == "position"

    assert peer.spin_until(is_position)
    assert peer.spin_until(lambda: output.get_subscription_count() > 0)
    peer.meet()
    for scan, points in enumerate(clouds[60:], 60):
        before = len(found)
        output.publish(cloud(scan, points))
        assert peer.spin_until(lambda count=before: len(found) > count), scan
    rows = [
        (stamp_ns * 1e-9 - 1000.0, label, *place)
        for each in map(estimates.from_msg, found)
        for stamp_ns in [each.stamp_ns]
        for label, place in zip(each.track_id, each.position, strict=True)
    ]
    tracks = np.round(np.transpose(rows), 6)
    late = street.TIMES[60:SCANS]
    truth = street.true_tracks(SEED)
    kept = np.isin(truth["time"], late)
    truth = {name: column[kept] for name, column in truth.items()}
    # Those of the clouds that were held are here too, but for some that came before the discovery.
    assert tracks[0].min() < street.TIMES[50]
    tracks = tracks[:, np.isin(tracks[0], np.round(late, 6))]
    tracks = dict(zip(("time", "label", "x", "y"), tracks, strict=True))
    scored = evaluate(truth, tracks, cutoff=1.0, times=late)
    assert scored["missed"] * len(late) < 0.01 * len(truth["time"])
    assert scored["identity_switches"] == 0
    peer.said(tracker, "lidar: its clouds have x and y and no range: tracked as positions, as")
