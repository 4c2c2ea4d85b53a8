"""Faulty clouds to a live tracker in space: each is named by a sentence, and tracking goes on."""

import numpy as np
from live_radars import options, reliable
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud
from msg_adapters.targets import estimates

CLOUDS, DETECTIONS = 40, 6
RADAR = {
    "fields.elevation": "elevation",
    "fields.amplitude": "''",
    "detection_probability": 0.9,
    "range_std": 2.0,
    "azimuth_std_deg": 0.5,
    "max_range": 5000.0,
    "clutter_max_range": 5000.0,
}
LIDAR = {"kind": "position", "area": [-100.0, -100.0, 100.0, 100.0]}


def polar(rng, elevation):
    count = DETECTIONS
    distance, azimuth = rng.uniform(500.0, 4e3, count), rng.uniform(-3.0, 3.0, count)
    return {"range": distance, "azimuth": azimuth, "elevation": elevation(rng, count)}


def places(rng, **more):
    x, y = rng.uniform(-90.0, 90.0, (2, DETECTIONS))
    return {"x": x, "y": y, "z": rng.uniform(0.0, 2.0, DETECTIONS)} | {
        name: np.full(DETECTIONS, value) for name, value in more.items()
    }


AREA = {"area_x_min": 9.0, "area_y_min": 0.0, "area_x_max": -9.0, "area_y_max": 5.0}
BOTH = {"range": 50.0, "azimuth": 0.3}
# The parameters of each sensor, its cloud, and a part of the sentence; empty if it is no fault.
CASES = {
    "unknown": (
        RADAR,
        lambda rng: polar(rng, lambda _, count: np.full(count, np.nan)),
        "detections without an elevation (NaN, or 0 in a whole cloud)",
    ),
    "degrees": (
        RADAR,
        lambda rng: polar(rng, lambda rng, count: rng.uniform(5.0, 50.0, count)),
        "elevations beyond the zenith, which are not used; if they are in degrees or milliradians, "
        "set degrees.",
    ),
    "beyond": (
        RADAR,
        lambda rng: polar(rng, lambda rng, count: rng.uniform(1.7, 3.0, count)),
        "elevations beyond the zenith",
    ),
    "below": (
        RADAR,
        lambda rng: polar(rng, lambda rng, count: rng.uniform(-1.0, -0.2, count)),
        "below the floor of height_prior",
    ),
    "overhead": (RADAR, lambda rng: polar(rng, lambda _, count: np.full(count, 1.5707)), ""),
    "indefinite": (
        LIDAR,
        lambda rng: places(rng, x_std=0.2, y_std=0.2, correlation=1.5),
        "covariances that are not positive definite",
    ),
    "millions": (
        {**LIDAR, "area": [2e6, 2e6, 4e6, 4e6], "position": [-3e6, -3e6, 0.0]},
        lambda rng: {name: each + 3e6 for name, each in places(rng).items()},
        "positions 1000 km or more from the sensor",
    ),
    "absurd": (LIDAR, lambda rng: places(rng) | {"z": np.full(DETECTIONS, 1e30)}, "absurd"),
    "fast": (LIDAR, lambda rng: places(rng, vx=1e9, vy=0.0, vz=0.0), "velocities that are infin"),
    "outside": ({"kind": "position"}, lambda rng: places(rng, x=5e3), "points dropped: area"),
    "edges": (LIDAR, lambda rng: places(rng, **AREA), "edges.area replaces it"),
    # Both places and ranges to a sensor of positions: the places count.
    "both": (LIDAR, lambda rng: places(rng, **BOTH), ""),
}


def test_faults_of_clouds_in_space_are_named_and_do_not_end_the_tracker(processes, peer):
    given = {
        f"{name}.{key}": value for name, case in CASES.items() for key, value in case[0].items()
    }
    topics = [f"/{name}/detections" for name in CASES]
    arguments = options(state="space", sensors=f"[{', '.join(CASES)}]", interval_s=0.1, **given)
    tracker = processes.start("tracker", "--ros-args", *arguments, *reliable(*topics))
    outputs = [peer.publisher(PointCloud2, topic, 400) for topic in topics]
    found = peer.collect(PointCloud2, "/tracker/filtered/estimates", 400)
    assert peer.spin_until(lambda: all(each.get_subscription_count() for each in outputs))
    rng = np.random.default_rng(3)
    for number in range(CLOUDS):
        before, stamp_ns = len(found), 10**12 + number * 10**8
        for output, (name, (_, columns, _)) in zip(outputs, CASES.items(), strict=True):
            output.publish(point_cloud.encode(stamp_ns, name, columns(rng)))
        if number:
            assert peer.spin_until(lambda count=before: len(found) > count), number
    for _, _, said in CASES.values():
        if said:
            peer.said(tracker, said)
    for each in map(estimates.from_msg, found):
        assert np.isfinite(each.state).all()
        assert np.isfinite(each.covariance).all()
