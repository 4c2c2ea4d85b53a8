"""A live tracker that learns where clutter comes from, over DDS, and the picture of it."""

import numpy as np
import pytest
from bag_content import recorded
from live_and_offline import answered, assert_alike, started
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import names
from msg_adapters.outgoing import map_layers
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.report import load
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.tools import simulate, track_bag

REVOLUTIONS = 32
PARAMETERS = {
    "sensors": ["mast"],
    "births": [],
    "interval_s": 2.5,
    "lag": 0,
    "detection_births.rates": [0.2, 0.2],
    "detection_births.std": [5.0],
    "cv.noise_density": 0.02,
    "ct.noise_density": 0.02,
    "spawn.rate": 0.0,
    "mast.position": [300.0, -200.0],
    "mast.yaw_deg": 50.0,
    "mast.range_std": 10.0,
    "mast.azimuth_std_deg": 0.2,
    "mast.max_range": 8e3,
    "mast.clutter_max_range": 8e3,
    "mast.clutter_rate": 3.0,
    "mast.detection_probability": 0.9,
    "mast.clutter_amplitude": "learned",
    "mast.clutter_map": True,
}
QUAY = {
    "points": [-600.0, 3000.0, 600.0, 3000.0],
    "spacing": 100.0,
    "detection_probability": 0.7,
    "amplitude": {"law": "log_normal", "level_db": 16.0, "std_db": 5.0},
}
SHIP = {"class_id": 0, "snr_db": 35.0, "first_scan": 0, "last_scan": REVOLUTIONS - 1}
SHIP |= {"position": [2000.0, 1000.0], "velocity": [-6.0, 5.0]}
DOCUMENT = {"interval_s": 2.5, "scans": REVOLUTIONS, "targets": [SHIP], "reflectors": [QUAY]}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Return a bag of a quay and a ship, and the tracker's configuration for it."""
    path, config = tmp_path_factory.mktemp("harbour") / "bag", resolve(PARAMETERS)
    run = scenario_file.resolve(DOCUMENT, config.model.radars)
    simulate.write_bag(path, run, config, 3)
    return path, config


@pytest.fixture(scope="module")
def offline(bag):
    path, config = bag
    out = path.parent / "offline"
    track_bag.track_bag(BagReader(path), config, out)
    return out


def on_the_quay(found):
    return int(
        np.count_nonzero(
            (np.abs(found.position[:, 1] - 3000.0) < 100.0) & (np.abs(found.position[:, 0]) < 700.0)
        )
    )


def is_of_the_quay(shown):
    """Whether a picture is darkest where the quay is, and pale elsewhere."""
    left, _, bottom, _ = shown.extent
    rows, columns = np.nonzero(shown.density > 0.2 * shown.density.max())
    x, y = left + (columns + 0.5) * shown.cell, bottom + (rows + 0.5) * shown.cell
    on = (np.abs(y - 3000.0) < 100.0) & (np.abs(x) < 700.0)
    return bool(on.all() and np.ptp(x) > 900.0)


def test_offline_tracks_of_a_quay_end_and_its_picture_is_recorded(bag, offline, tmp_path):
    path, config = bag
    plain = resolve({**PARAMETERS, "mast.clutter_map": False})
    track_bag.track_bag(BagReader(path), plain, tmp_path / "plain")
    assert min(on_the_quay(found) for found in recorded(tmp_path / "plain")[24:]) > 5
    quay = [on_the_quay(found) for found in recorded(offline)]
    assert len(quay) == REVOLUTIONS
    assert sum(quay[24:]) == 0
    record = load.record(offline, config)
    assert is_of_the_quay(record.clutter)
    # Where nothing is learned there is no topic.
    assert names.clutter_map() not in BagReader(bag[0]).types


@pytest.mark.live
def test_what_is_learned_live_is_what_is_learned_offline(bag, offline, processes, peer, tmp_path):
    path, config = bag
    (radar,) = config.inputs
    outputs, found, _ = started(processes, peer, tmp_path, PARAMETERS, {radar.topic: PointCloud2})
    sent = [entry.data for entry in BagReader(path).messages([radar.topic])]
    answered(peer, outputs[radar.topic], found, sent)
    heard = assert_alike(found, recorded(offline))
    # A viewer that comes late has the picture at once: no scan comes any more.
    grids = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    peer.node.create_subscription(OccupancyGrid, "/tracker/clutter_map", grids.append, latched)
    assert peer.spin_until(lambda: grids)
    (grid,) = grids
    assert grid.header.frame_id == "map"
    # Every ten seconds by the stamps: the last time was 0 to 10 s before the end.
    age_s = heard[-1].stamp_ns * 1e-9 - (grid.header.stamp.sec + grid.header.stamp.nanosec * 1e-9)
    assert 0.0 <= age_s < 10.0
    assert is_of_the_quay(map_layers.clutter_from_msg(grid))
    assert 60 < max(grid.data) <= 100
    assert min(grid.data) == 0
