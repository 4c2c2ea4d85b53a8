import math

import numpy as np
import pytest
import radar_scans
from message_types import RadarReturn, RadarScan
from numpy.testing import assert_allclose
from samples import FRAME, STAMP_NS, radar

from msg_adapters.encoding import RejectedMessageError, interfaces, stamps
from msg_adapters.incoming import radar_scan
from msg_adapters.incoming.readers import READERS
from phd_jdtc_ros.core.types import Detections


def scan(*rows, frame=FRAME):
    """Return a scan of (range, azimuth, elevation, amplitude) rows."""
    names = ("range", "azimuth", "elevation", "amplitude")
    returns = [RadarReturn(**dict(zip(names, row, strict=True))) for row in rows]
    return RadarScan(header=stamps.header(STAMP_NS, frame), returns=returns)


def test_from_msg_reads_amplitudes_azimuths_and_slant_ranges():
    for in_db in (False, True):
        setting = radar(amplitude_in_db=in_db, amplitude_offset_db=-7.0)
        report = radar_scan.from_msg(scan((1000.0, 0.5, 0.0, 27.0)), setting)
        assert_allclose(report.detections.amplitude, [np.sqrt(200.0)], rtol=1e-12)
        assert report.stamp_ns == STAMP_NS
    report = radar_scan.from_msg(scan((1000.0, 0.5, 0.0, 20.0)), radar(compass=True))
    assert report.detections.measurement.tolist() == [[1000.0, 0.5]]
    report = radar_scan.from_msg(scan((1000.0, 0.5, math.radians(60.0), 20.0)), radar())
    assert_allclose(report.detections.measurement, [[500.0, 0.5]], rtol=1e-12)
    report = radar_scan.from_msg(scan((1e3, 0.5, 0.0, 20.0)), radar(amplitude_field=""))
    assert report.detections.amplitude is None


def test_from_msg_rejects_another_frame_a_stamp_without_sense_and_too_many(monkeypatch):
    early = scan()
    early.header.stamp.sec = -1
    many = scan(*[(1e3, 0.0, 0.0, 20.0)] * 2)
    monkeypatch.setattr(radar_scan, "MAX_POINTS", 1)
    for message, reason in ((scan(frame="map"), "frame"), (early, "schema"), (many, "oversize")):
        with pytest.raises(RejectedMessageError) as caught:
            radar_scan.from_msg(message, radar())
        assert caught.value.reason == reason


def test_from_msg_reads_the_installed_messages():
    scan_class = interfaces.installed_class(READERS["radar_scan"].type_name)
    if scan_class is None:
        pytest.skip("radar_msgs is not installed")
    empty = scan_class(header=stamps.header(STAMP_NS, FRAME))
    assert len(radar_scan.from_msg(empty, radar()).detections) == 0


ROWS = [(1000.0, 0.5, 0.25, 20.0), (2000.0, -1.5, 0.0, 35.0)]


@pytest.mark.parametrize("frame", ["r", "ra", "rad", "radar", "radar_front_left"])
@pytest.mark.parametrize("little_endian", [True, False])
def test_from_cdr_reads_what_from_msg_does_however_long_the_frame(frame, little_endian):
    # The frame's length moves everything behind it.
    setting = radar(frame=frame)
    data = radar_scans.cdr(STAMP_NS, frame, ROWS, little_endian)
    expected = radar_scan.from_msg(scan(*ROWS, frame=frame), setting)
    report = radar_scan.from_cdr(data, setting)
    assert report.stamp_ns == STAMP_NS
    assert_allclose(report.detections.measurement, expected.detections.measurement, rtol=1e-6)
    assert_allclose(report.detections.amplitude, expected.detections.amplitude, rtol=1e-6)


def test_an_empty_scan_is_an_empty_scan():
    recorded = radar_scan.from_cdr(radar_scans.cdr(STAMP_NS, FRAME, []), radar())
    for report in (recorded, radar_scan.from_msg(scan(), radar())):
        assert report.detections.measurement.shape == (0, 2)
        assert report.detections.amplitude is not None


def test_from_cdr_rejects_early_ends_and_counts_that_lie():
    data = radar_scans.cdr(STAMP_NS, FRAME, ROWS)
    for length in range(len(data)):
        with pytest.raises(RejectedMessageError) as caught:
            radar_scan.from_cdr(data[:length], radar())
        assert caught.value.reason in ("schema", "frame")
    data = bytearray(radar_scans.cdr(STAMP_NS, FRAME, ROWS))
    place = data.index((len(ROWS)).to_bytes(4, "little"), 16)
    data[place : place + 4] = b"\xff" * 4
    with pytest.raises(RejectedMessageError) as caught:
        radar_scan.from_cdr(bytes(data), radar())
    assert caught.value.reason == "oversize"


def test_to_cdr_writes_what_an_independent_decoder_and_the_own_one_read():
    rate = np.array([-2.25, 7.0])
    place, level = np.array([[1000.5, 0.5], [2e3, -3.0]]), np.array([4.0, 8.0])
    given = Detections(place, level, range_rate=rate)
    changes = {"amplitude_offset_db": -17.0, "range_rate_field": "yes"}
    layout = radar(**changes, compass=True, frame="mast_")
    data = radar_scan.to_cdr(given, STAMP_NS, layout)
    decoded = radar_scans.decoded(data)
    assert [r.range for r in decoded.returns] == [1000.5, 2e3]
    assert (decoded.header.frame_id, decoded.header.stamp.sec) == ("mast_", STAMP_NS // 10**9)
    report = radar_scan.from_cdr(data, layout)
    assert report.stamp_ns == STAMP_NS
    assert_allclose(report.detections.measurement, given.measurement, rtol=1e-7)
    assert_allclose(report.detections.amplitude, given.amplitude, rtol=1e-6)
    assert_allclose(report.detections.range_rate, rate)


def test_definition_and_hash_are_those_of_the_type():
    assert radar_scans.type_hash() == radar_scan.TYPE_HASH
    assert [line.split() for line in radar_scan.DEFINITION.splitlines()] == [
        line.split() for line in radar_scans.DEFINITION.splitlines()
    ]


def test_doppler_velocities_are_read_where_they_are_asked_for():
    message = scan((1000.0, 0.5, 0.0, 20.0))
    message.returns[0].doppler_velocity = -3.5
    assert radar_scan.from_msg(message, radar()).detections.range_rate is None
    found = radar_scan.from_msg(message, radar(range_rate_field="yes")).detections
    assert found.range_rate.tolist() == [-3.5]
    recorded = radar_scans.cdr(STAMP_NS, FRAME, [(1000.0, 0.5, 0.0, 20.0)])
    found = radar_scan.from_cdr(recorded, radar(range_rate_field="yes")).detections
    assert found.range_rate.tolist() == [7.0]
