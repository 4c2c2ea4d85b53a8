"""Simulated self-reports: what transmitters say, who hears it, and what receivers send on."""

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.simulation import scenario_file, self_reports
from phd_jdtc_ros.tools import simulate
from phd_jdtc_ros.transponders.messages import ICAO, MMSI
from phd_jdtc_ros.transponders.stream import ReportStream, StreamSettings
from phd_jdtc_ros.transport.network import Datagram

SPEED, SECONDS, FIRST = 5.0, 240.0, 211_000_001


def scene(kind="mmsi", speed=SPEED, **reception):
    """Return a scenario of two targets that go east, its receiver, and what it hears of them."""
    given = {"ais.kind": "reports", "ais.identity": kind, "world_origin": [54.0, 10.0, 0.0]}
    config = resolve({"sensors": ["radar", "ais"], "radar.rotation_s": 2.5, **given}, SystemPlane)
    legs = [{"duration_s": SECONDS}]
    target = {"class_id": 0, "position": [0.0, 0.0], "velocity": [speed, 0.0], "legs": legs}
    document = {
        "start_s": 1000.0,
        "interval_s": 1.0,
        "scans": int(SECONDS) + 1,
        "targets": [target, {**target, "position": [0.0, 5000.0]}],
        "self_reports": {"ais": reception},
    }
    run = scenario_file.resolve(document, polar_radars(config.model.radars))
    faults = []
    found = self_reports.receptions(document, 2, faults)
    if faults:
        raise ConfigError(*faults)
    self_reports.check(found, config.receivers)
    own = config.receivers[0]
    return run, own, self_reports.received(run, found["ais"], own, seed=3)


def places(own, reports):
    """Return times after scan 0, positions and reported speeds of reports."""
    heard = [each.report.heard for each in reports]
    x, y = own.plane.to_plane([h.latitude for h in heard], [h.longitude for h in heard])
    time_s = np.array([each.report.time_ns for each in reports]) * 1e-9 - 1000.0
    return time_s, np.stack([x, y], axis=1), np.array([h.speed for h in heard])


EXACT = {"lost": 0.0, "position_std": 0.0, "velocity_std": 0.0, "time_step_s": 0.0}
SHIP = {"target": 1, "address": FIRST}


@pytest.mark.parametrize(
    ("kind", "speed", "transmitter", "interval_s"),
    [
        ("mmsi", 5.0, {}, 10.0),
        ("mmsi", 9.0, {}, 6.0),
        ("mmsi", 13.0, {}, 2.0),
        ("mmsi", 5.0, {"class_b": True}, 30.0),
        ("icao", 80.0, {}, 1.0),
    ],
)
def test_transmitters_report_at_the_intervals_of_their_kind(kind, speed, transmitter, interval_s):
    _, _, found = scene(kind, speed, transmitters=[{**SHIP, **transmitter}], **EXACT)
    times = np.array([each.report.time_ns for each in found]) * 1e-9
    np.testing.assert_allclose(np.diff(times), interval_s, atol=1e-6)
    assert {each.report.heard.space for each in found} == {MMSI if kind == "mmsi" else ICAO}


def test_positions_are_those_of_the_antenna_and_leave_the_ship_when_they_lie():
    lie = {"drift": [0.0, 2.0], "lies_from_s": 100.0, "antenna": [30.0, -4.0]}
    _, own, found = scene(transmitters=[{**SHIP, **lie}], **EXACT)
    time_s, place, speed = places(own, found)
    away = 2.0 * np.maximum(time_s - 100.0, 0.0)
    expected = np.stack([SPEED * time_s + 30.0, away - 4.0], axis=1)
    np.testing.assert_allclose(place, expected, atol=0.05)
    np.testing.assert_allclose(speed, SPEED, atol=1e-3)
    _, own, found = scene(transmitters=[{**SHIP, **lie, "true_velocity": False}], **EXACT)
    time_s, _, speed = places(own, found)
    assert speed[time_s > 100.0].min() > SPEED + 0.3


def test_reports_are_lost_hidden_late_and_in_whole_seconds():
    hidden = {"hidden": [60.0, 120.0], "from_s": 20.0, "to_s": 200.0}
    _, own, found = scene(
        speed=13.0, transmitters=[{**SHIP, **hidden}], lost=0.3, delay_s=[0.5, 2.0]
    )
    time_s = places(own, found)[0]
    assert time_s.min() > 19.0
    assert time_s.max() < 201.0
    assert not ((time_s > 61.0) & (time_s < 119.0)).any()
    assert 35 < len(found) < 56
    np.testing.assert_allclose(time_s % 1.0, 0.5)
    late_s = [(each.receipt_ns - each.report.time_ns) * 1e-9 for each in found]
    assert min(late_s) >= 0.0
    assert max(late_s) <= 2.5


def test_sentences_say_what_was_simulated():
    pytest.importorskip("pyais")
    two = [
        {**SHIP, "name": "ALMA", "type": 70, "length": 80.0, "antenna": [20.0, 0.0]},
        {"target": 2, "address": FIRST + 1, "class_b": True},
    ]
    _, _, found = scene(transmitters=two, lost=0.0)
    stream = ReportStream(StreamSettings(500_000_000, 10 * 10**9))
    pieces = [Datagram(line) for _, line in simulate.lines(found)]
    batches = [each for piece in pieces for each in stream.feed(piece) if each]
    read = [each for _, batch in (*batches, *stream.finish()) for each in batch.reports]
    assert len(read) == len(found)
    for one, other in zip(found, read, strict=True):
        sent = one.report.heard
        assert other.time_ns == one.report.time_ns
        assert other.heard.address == sent.address
        assert other.heard.interval_s == sent.interval_s
        assert other.heard.latitude == pytest.approx(sent.latitude, abs=2e-6)
        assert other.heard.speed == pytest.approx(sent.speed, abs=0.03)
    last = next(each.heard for each in reversed(read) if each.heard.address == FIRST)
    assert (last.name, last.type, last.hull) == ("ALMA", 70, (20, 60, 6, 6))


def test_lines_of_aircraft_say_what_was_simulated():
    _, _, found = scene("icao", 80.0, transmitters=[{**SHIP, "address": 0x3C6500}])
    stream = ReportStream(StreamSettings(500_000_000, 10 * 10**9, None, 1000 * 10**9))
    pieces = [Datagram(line) for _, line in simulate.lines(found)]
    batches = [each for piece in pieces for each in stream.feed(piece) if each]
    read = [each for _, batch in (*batches, *stream.finish()) for each in batch.reports]
    assert len(read) == len(found)
    np.testing.assert_allclose(
        [each.heard.latitude for each in read],
        [each.report.heard.latitude for each in found],
        atol=1e-6,
    )


@pytest.mark.parametrize(
    ("reception", "text"),
    [
        ({"transmitters": [{"target": 3, "address": 1}]}, "target: 3 given, must be from 1 to 2"),
        ({"transmitters": [{"target": 1}]}, "address: missing"),
        ({"lost": 2.0}, "self_reports.ais.lost"),
        ({"noise": 2.0}, "self_reports.ais.noise: unknown key"),
    ],
)
def test_faults_name_the_key(reception, text):
    with pytest.raises(ConfigError, match=text):
        scene(**reception)


def test_receiver_must_be_one_of_the_trackers():
    found = {"other": self_reports.Reception()}
    with pytest.raises(ConfigError, match=r"self_reports.other: must be a sensor of kind: reports"):
        self_reports.check(found, ())
