"""Bags of ``radar_msgs/RadarScan``, whose package is not installed."""

import numpy as np
import pytest
import radar_scans
from bag_content import recorded, write

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming import detections
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import Topic
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.report import load

RADARS = [names.detections("radar_1"), names.detections("radar_2")]


AS_SCANS = {"radar_1.message": "radar_scan", "radar_2.message": "radar_scan"}


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


def test_track_bag_reads_and_copies_radar_scans_without_radar_msgs(scan_bag, tracked, track):
    given = (word for item in AS_SCANS.items() for word in ("-p", ":=".join(item)))
    status, out = track(scan_bag, *given)
    assert status == 0
    for kind in ("filtered", "smoothed"):
        of_scans, of_clouds = recorded(out, kind), recorded(tracked, kind)
        assert [e.stamp_ns for e in of_scans] == [e.stamp_ns for e in of_clouds]
        # Levels in decibels are rounded to single precision.
        for one, other in zip(of_scans, of_clouds, strict=True):
            np.testing.assert_allclose(one.state, other.state, rtol=0, atol=1.0)
    source, copy = BagReader(scan_bag), BagReader(out)
    for topic in RADARS:
        assert copy.topic(topic) == source.topic(topic)
        assert [m.data for m in copy.messages([topic])] == [
            m.data for m in source.messages([topic])
        ]
    # A report shows them too.
    record = load.record(out, resolve(AS_SCANS))
    assert len(record.plots) == 16
    assert sum(len(plot.position) for plot in record.plots) > 100
