"""Bags of ``radar_msgs/RadarScan``, whose package is not installed."""

import numpy as np
import pytest
import radar_scans
from bag_content import recorded, write

from msg_adapters import detections, interfaces, names
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import Topic
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.report import load

RADARS = [names.detections("radar_1"), names.detections("radar_2")]


@pytest.fixture
def scan_bag(short_bag, tmp_path):
    """Return the short bag with ``radar_msgs/RadarScan`` in the place of clouds."""
    inputs = {radar.topic: radar for radar in resolve({}).inputs}

    def as_scan(topic, data, log_time):
        if topic not in inputs:
            return topic, data, log_time
        report = detections.from_msg(interfaces.decode(data, names.CLOUD), inputs[topic])
        level = 20.0 * np.log10(report.detections.amplitude) - 10.0 * np.log10(2.0)
        rows = [
            (r, a, 0.0, s) for (r, a), s in zip(report.detections.measurement, level, strict=True)
        ]
        return topic, radar_scans.cdr(report.stamp_ns, inputs[topic].frame, rows), log_time

    described = {"definition": radar_scans.DEFINITION, "type_hash": "RIHS01_0"}
    topics = [Topic(topic, radar_scans.TYPE, **described) for topic in inputs]
    entries = (as_scan(e.topic, e.data, e.log_time_ns) for e in BagReader(short_bag).messages())
    return write(tmp_path / "scans", [*topics, Topic(names.TRUTH, names.CLOUD)], entries)


AS_SCANS = ["-p", "radar_1.message:=radar_scan", "-p", "radar_2.message:=radar_scan"]


def test_track_bag_reads_radar_scans_where_radar_msgs_is_not_installed(scan_bag, tracked, track):
    status, out = track(scan_bag, *AS_SCANS)
    assert status == 0
    for source in ("filtered", "smoothed"):
        of_scans, of_clouds = recorded(out, source), recorded(tracked, source)
        assert [e.stamp_ns for e in of_scans] == [e.stamp_ns for e in of_clouds]
        # Levels in decibels are rounded to single precision.
        for one, other in zip(of_scans, of_clouds, strict=True):
            np.testing.assert_allclose(one.state, other.state, rtol=0, atol=1.0)


def test_track_bag_copies_radar_scans_as_they_are(scan_bag, track):
    _, out = track(scan_bag, *AS_SCANS)
    source, copy = BagReader(scan_bag), BagReader(out)
    for topic in RADARS:
        assert copy.topic(topic) == source.topic(topic)
        assert [m.data for m in copy.messages([topic])] == [
            m.data for m in source.messages([topic])
        ]


def test_report_shows_the_detections_of_radar_scans(scan_bag, track):
    _, out = track(scan_bag, *AS_SCANS)
    given = {"radar_1.message": "radar_scan", "radar_2.message": "radar_scan"}
    record = load.record(out, resolve(given))
    assert len(record.plots) == 16
    assert sum(len(plot.position) for plot in record.plots) > 100
