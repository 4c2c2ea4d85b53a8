"""The live bridge of reports between sockets on the loopback interface and DDS."""

import signal
import socket
import time

import ais_sentences as made
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live_radars import Health
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import point_cloud
from msg_adapters.outgoing import diagnostics

pytestmark = pytest.mark.live
LOOPBACK, DEADLINE_S = "127.0.0.1", 60.0
WANTED = {"latitude": ("f8",), "time": ("f8",), "address": ("u4",)}


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((LOOPBACK, 0))
        return sock.getsockname()[1]


class Site:
    """A bridge with an input of UDP and one of TCP, and what it publishes."""

    def __init__(self, processes, peer):
        self.peer = peer
        self.processes = processes
        self.port = free_port()
        self.server = socket.create_server((LOOPBACK, 0))
        self.tcp = self.server.getsockname()[1]
        self.clouds = peer.collect(PointCloud2, "/ais/reports", 1000)
        self.aircraft = peer.collect(PointCloud2, "/adsb/reports", 1000)
        self.health = Health(peer, "/report_bridge")

    def start(self, *arguments):
        """Start the bridge and wait until it receives."""
        inputs = f"inputs:=['{LOOPBACK}:{self.port}', 'tcp://{LOOPBACK}:{self.tcp}']"
        given = ["-p", inputs, *arguments]
        process = self.processes.start("report_bridge", "--ros-args", *given)
        self.peer.said(process, "receiving")
        self.peer.meet("/report_bridge")
        return process

    def send(self, data):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.sendto(data, (LOOPBACK, self.port))

    def addresses(self, clouds):
        found = [point_cloud.decode(cloud, WANTED)["address"] for cloud in clouds]
        return sorted({*np.concatenate(found).tolist()}) if found else []


@pytest.fixture
def site(processes, peer):
    found = Site(processes, peer)
    yield found
    found.server.close()


def test_datagrams_and_streams_become_clouds(site):
    process = site.start()
    there, _ = site.server.accept()
    with there:
        for ship in (211000001, 211000002):
            site.send(made.class_a(ship, int(time.time()) % 60))
        line = made.sbs(latitude=50.0, longitude=8.0, day="", time="") + b"\r\n"
        there.sendall(line[:30])
        site.peer.pace(0.2)
        there.sendall(line[30:])
        ships = [211000001, 211000002]
        assert site.peer.spin_until(lambda: site.addresses(site.clouds) == ships)
        assert site.peer.spin_until(lambda: site.addresses(site.aircraft) == [0x4CA2D6])
    found = point_cloud.decode(site.clouds[0], WANTED)
    assert abs(found["time"][0] - time.time()) < 20.0
    process.send_signal(signal.SIGINT)
    assert process.wait(DEADLINE_S) == 0
    assert "stopped; reports: adsb 1, ais 2; left out: no_time 1" in process.log.read_text()


def test_a_silent_input_is_named_and_nothing_received_is_a_failure(site):
    site.server.close()
    process = site.start("-p", "replayed:=true")
    status = site.health.until_level("input", DiagnosticStatus.WARN, "refused")
    assert status.message == f"tcp://127.0.0.1:{site.tcp}: Connection refused"
    site.peer.said(process, "no data for")
    process.send_signal(signal.SIGINT)
    assert process.wait(DEADLINE_S) == 1
    assert "nothing was received on" in process.log.read_text()


def test_faults_are_counted_by_name_in_the_diagnostics(site):
    site.start()
    for data in (b"hello\n", made.class_a(0, 5), made.class_a(5, 5)[:-2] + b"00"):
        site.send(data)
    status = site.health.until_level("input", DiagnosticStatus.WARN, "checksum 1")
    values = diagnostics.values_of(status)
    assert {name: values[name] for name in ("other_line", "no_address", "checksum")} == {
        "other_line": "1",
        "no_address": "1",
        "checksum": "1",
    }
