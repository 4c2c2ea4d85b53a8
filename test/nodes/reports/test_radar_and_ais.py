"""A radar and sentences of AIS through the live bridge and the live tracker."""

import re
import socket

import numpy as np
import pytest
import yaml
from live_and_offline import started
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import interfaces, names, point_cloud
from msg_adapters.targets import estimates, truth
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.reader import BagReader

pytestmark = pytest.mark.live
LOOPBACK = "127.0.0.1"
BAG = resources.find("bags/harbour_ais")
RADAR, AIS, TURN_S, TURNS = "/mast/detections", "/ais/reports", 2.4, 30
WANTED = {"address": ("u4",)}
POSITIONS = ("1", "B")  # First letters of sentences of class A and class B
GIVEN = yaml.safe_load((BAG / "parameters.yaml").read_text())["/**/tracker"]["ros__parameters"]


class Site:
    """A bridge of reports, and the clouds that it has published."""

    def __init__(self, processes, peer):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind((LOOPBACK, 0))
            self._port = sock.getsockname()[1]
        self._peer, self.sent = peer, 0
        self.clouds = peer.collect(PointCloud2, AIS, 1000)
        given = ["-p", f"inputs:=['{LOOPBACK}:{self._port}']", "-p", "replayed:=true"]
        process = processes.start("report_bridge", "--ros-args", *given)
        peer.said(process, "receiving")
        lines = (BAG / "recording.nmea").read_bytes().splitlines(keepends=True)
        self._lines = [(int(re.match(rb".c:(\d+)", line)[1]), line) for line in lines]

    def send_until(self, time_s):
        """Send the sentences that were received until a time, and wait for their clouds."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            while self._lines and self._lines[0][0] < time_s:
                _, line = self._lines.pop(0)
                sock.sendto(line, (LOOPBACK, self._port))
                self.sent += line.split(b",")[5][:1].decode() in POSITIONS
        assert self._peer.spin_until(lambda: self.count() == self.sent), (self.count(), self.sent)

    def count(self):
        return sum(len(point_cloud.decode(cloud, WANTED)["address"]) for cloud in self.clouds)


def recorded(topic):
    return [entry.data for entry in BagReader(BAG).messages([topic])]


def test_ships_with_ais_are_one_track_with_both(processes, peer, tmp_path):
    site = Site(processes, peer)
    types = {RADAR: PointCloud2, AIS: PointCloud2}
    outputs, found, _ = started(processes, peer, tmp_path, GIVEN, types)
    clouds = [interfaces.decode(data, names.CLOUD) for data in recorded(RADAR)]
    for turn in range(TURNS):
        site.send_until(1000.0 + TURN_S * (turn + 1))
        for cloud in clouds[8 * turn : 8 * turn + 8]:
            outputs[RADAR].publish(cloud)
        assert peer.spin_until(lambda turn=turn: len(found) >= turn), turn
    last = estimates.from_msg(found[-1])
    told = last.reports
    (row,) = ((told.owned > 0.99) & (told.alone == 0)).nonzero()
    # Two ships send one address, and another one lies later.
    assert len(set(told.address[row].tolist())) >= 6
    known = [truth.from_msg(interfaces.decode(data, names.CLOUD)) for data in recorded(names.TRUTH)]
    true = min(known, key=lambda each: abs(each.stamp_ns - last.stamp_ns))
    place = last.position + last.velocity * (true.stamp_ns - last.stamp_ns) * 1e-9
    away = np.hypot(*(place[row, None] - true.position).transpose(2, 0, 1)).min(axis=1)
    assert away.max() < 50.0  # The radar's errors are 35 m across.
    assert np.sqrt(np.mean(away**2)) < 20.0


def test_reports_alone_are_tracks(processes, peer, tmp_path):
    site = Site(processes, peer)
    given = {name: value for name, value in GIVEN.items() if name != "mast"} | {"sensors": ["ais"]}
    _, found, _ = started(processes, peer, tmp_path, given, {AIS: PointCloud2})
    for turn in range(TURNS):
        site.send_until(1000.0 + TURN_S * (turn + 1))
    # In an interval without reports no time passes.
    assert peer.spin_until(lambda: len(found) > TURNS // 2), len(found)
    last = estimates.from_msg(found[-1])
    assert last.reports.alone.all()
    assert len(set(last.reports.address.tolist())) >= 6
    assert (last.reports.heard_ns > last.stamp_ns - 60 * 10**9).all()
    assert len(set(last.track_id.tolist())) == len(last)
