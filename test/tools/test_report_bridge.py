"""Recordings of AIS and ADS-B to bags and tables."""

import csv
import gzip
import re
import sys
from pathlib import Path

import ais_sentences as made
import asterix_records
import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from msg_adapters.encoding import interfaces, names, point_cloud
from msg_adapters.incoming import self_reports
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.core.types.reports import SelfReports, text_of
from phd_jdtc_ros.parameter_files import from_arguments

START = "2026-11-22T10:30:00"
START_NS = 1_795_343_400 * 10**9
SHIPS = [211000001, 211000002]


def log(scans=6):
    """Return a log: two ships every ten seconds, one with a name, and an aircraft."""
    lines = []
    for k in range(scans):
        for ship in SHIPS:
            lines.append(made.class_a(ship, 10 * k % 60, 54.5 + k / 1000, ship % 10 / 10))
        lines += made.voyage(SHIPS[0], "ANNA", 70)
        stamp = {"day": "2026/11/22", "time": f"10:30:{10 * k:02d}.250"}
        lines.append(made.sbs(latitude=50.0 + k / 100, longitude=8.0, height=35000, **stamp))
    return b"\r\n".join(lines) + b"\r\n"


@pytest.fixture
def bridge(tmp_path, capsys):
    """Return a function that bridges data into a new bag and returns status, bag and output."""

    def start(data, *arguments, out="--out"):
        path = tmp_path / "log.nmea"
        path.write_bytes(data)
        made_there = tmp_path / "made"
        status = run("report_bridge", [str(path), out, str(made_there), *arguments])
        return status, made_there, capsys.readouterr()

    return start


def reports(bag, network="ais"):
    """Return the columns of all reports of a network in a bag, one after the other."""
    wanted = {"latitude": ("f8",), "longitude": ("f8",), "time": ("f8",), "address": ("u4",)}
    wanted |= {"speed": ("f4",), "std": ("f4",), "space": ("u1",), "type": ("u1",)}
    clouds = [
        point_cloud.decode(interfaces.decode(entry.data, names.CLOUD), wanted)
        for entry in BagReader(bag).messages([names.reports(network)])
    ]
    return {name: np.concatenate([cloud[name] for cloud in clouds]) for name in wanted}


def test_a_log_becomes_a_bag(bridge):
    status, out, said = bridge(log(), "--start", START, out="--output")
    assert (status, said.err) == (0, "")
    assert said.out.splitlines() == [
        f"{out}: 12 clouds, 18 reports",
        "adsb: 6 reports on /adsb/reports",
        "ais: 12 reports on /ais/reports",
        "3 transmitters; messages: nmea 24, sbs 6",
        "left out or noted: names 6",
    ]
    found = reports(out)
    assert sorted({*found["address"].tolist()}) == SHIPS
    times = np.repeat(START_NS * 1e-9 + 10.0 * np.arange(6) + 0.5, 2)
    assert found["time"].tolist() == times.tolist()
    assert found["latitude"] == pytest.approx(np.repeat(54.5 + np.arange(6) / 1000, 2), abs=1e-6)
    # The name was heard twice before the third scan; the type with it.
    assert found["type"].tolist()[::2] == [0, 0, 70, 70, 70, 70]


def test_an_independent_reader_reads_the_bag(bridge):
    _, out, _ = bridge(log(), "--start", START)
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(out) as reader:
        (connection,) = (c for c in reader.connections if c.topic == "/ais/reports")
        clouds = [
            store.deserialize_cdr(data, connection.msgtype)
            for _, _, data in reader.messages([connection])
        ]
    fields = {field.name: field for field in clouds[-1].fields}
    assert (fields["name"].count, fields["name"].datatype, fields["latitude"].datatype) == (
        20,
        2,
        8,
    )
    point = clouds[-1].data.tobytes()[: clouds[-1].point_step]
    offset = fields["name"].offset
    assert point[offset : offset + 20].rstrip(b"\0") == b"ANNA"
    latitude = np.frombuffer(point, "<f8", 1, fields["latitude"].offset)
    assert latitude == pytest.approx(54.505, abs=1e-6)


def test_the_tracker_takes_all_reports_as_they_are(bridge):
    _, out, _ = bridge(log(), "--start", START)
    given = {
        "sensors": ["radar", "ais"],
        "ais.kind": "reports",
        "radar.geodetic": [54.5, 0.15, 0.0],
    }
    config = from_arguments.config_of({**given, "world_origin": [54.5, 0.15, 0.0]})
    entries = BagReader(out).messages(["/ais/reports"])
    found = [self_reports.from_cdr(entry.data, config.receivers[0]) for entry in entries]
    assert not any(each.dropped for each in found)
    told = SelfReports.concatenate([each.reports for each in found])
    assert sorted({*told.address.tolist()}) == SHIPS
    assert told.time_ns.tolist() == [
        START_NS + 10**10 * k + 10**9 // 2 for k in range(6) for _ in SHIPS
    ]
    # 12.3 knots to 45.1 degrees, with the bow at 47 degrees; the map's north is that of its origin.
    speed = np.hypot(*told.velocity.T)
    assert speed == pytest.approx(12.3 * 1852.0 / 3600.0, abs=1e-6)
    course = np.degrees(np.arctan2(told.velocity[:, 0], told.velocity[:, 1]))
    assert course == pytest.approx(45.1, abs=0.1)
    assert np.degrees(told.heading) == pytest.approx(43.0, abs=0.1)
    assert told.covariance[:, 0, 0].tolist() == [16.0] * 12
    assert text_of(told.name[-2]) == "ANNA"


def test_the_same_log_is_the_same_bag_packed_or_not(bridge, tmp_path):
    _, first, _ = bridge(log(), "--start", START)
    whole = {path.name: path.read_bytes() for path in first.iterdir()}
    first.rename(tmp_path / "first")
    _, second, _ = bridge(gzip.compress(log()), "--start", START)
    assert {path.name: path.read_bytes() for path in second.iterdir()} == whole


def test_a_capture_has_the_times_of_its_packets(bridge):
    packets = [
        (START_NS + k * 10**9, asterix_records.packet(made.class_a(SHIPS[0], k), port=10110))
        for k in range(5)
    ]
    packets.append((START_NS, asterix_records.packet(made.class_a(SHIPS[1], 0), port=9)))
    status, out, said = bridge(asterix_records.pcap(packets), "--port", "10110")
    assert (status, said.err) == (0, "")
    found = reports(out)
    assert found["address"].tolist() == [SHIPS[0]] * 5
    assert found["time"].tolist() == [START_NS * 1e-9 + k + 0.5 for k in range(5)]
    assert "other_port 1" in said.out


def test_a_table_has_a_row_for_each_report(bridge):
    status, out, _ = bridge(log(2), "--start", START, out="--csv")
    assert status == 0
    rows = list(csv.DictReader(out.open()))
    assert len(rows) == 6
    ship = next(row for row in rows if row["address"] == "211000001")
    assert ship["time"] == "1795343400.500000"
    assert float(ship["latitude"]) == pytest.approx(54.5, abs=2e-6)
    assert (ship["speed"], ship["course"], ship["heading"]) == ("6.33", "45.10", "47.00")
    aircraft = next(row for row in rows if row["network"] == "adsb")
    assert (aircraft["address"], aircraft["height"], aircraft["std"]) == (
        "4CA2D6",
        "10668.00",
        "50.00",
    )


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"hello\nworld\n", "of 0 messages 0 could be used as reports; left out: other_line 2"),
        (made.class_a(0, 5) + b"\n", "left out: no_address 1"),
        (made.class_a(5, 5)[:-1] + b"Z\n", "left out: no_sentence 1"),
        (b"*8D40621D58C382D690C8AC2863A7;\n", "frames without times cannot be used"),
        (b"", "is empty, nothing was recorded"),
    ],
    ids=["text", "no address", "no checksum", "no time", "empty"],
)
def test_a_log_of_which_nothing_is_used_ends_with_3_and_the_reason(bridge, data, reason):
    status, _, said = bridge(data)
    assert status == 3
    assert reason in said.err


def test_a_missing_library_is_named(bridge, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyais", None)
    status, _, said = bridge(made.class_a(5, 5) + b"\n")
    assert status == 2
    assert said.err.endswith("pyais is not installed, which AIS needs: pip install pyais\n")


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (["--start", "yesterday"], "must be a time such as 2026-11-22T10:30:00"),
        (["--port", "0"], "must be a port from 1 to 65535"),
        (["-p", "max_clock_offset_s:=0.0"], "max_clock_offset_s: 0.0 given, must be a finite"),
        (
            ["-p", "geodetic:=[91.0, 0.0, 0.0]"],
            "geodetic: [91.0, 0.0, 0.0] given, must be empty or",
        ),
    ],
)
def test_arguments_are_refused_with_what_is_allowed(bridge, arguments, fault, capsys):
    try:
        status, _, said = bridge(log(1), *arguments)
        text = said.err
    except SystemExit as error:
        status, text = error.code, capsys.readouterr().err
    assert status == 2
    assert fault in text


def test_the_page_of_the_bridge_lists_every_count():
    """Counts without an explanation cannot be acted upon."""
    root = Path(__file__).parents[2]
    page = (root / "docs" / "nodes" / "report_bridge.md").read_text()
    folder = root / "phd_jdtc_ros" / "transponders"
    used = set()
    for path in folder.glob("*.py"):
        text = path.read_text()
        used |= set(re.findall(r'counts\["(\w+)"\] \+= 1', text))
        used |= set(re.findall(r'return "(\w+)"$', text, re.MULTILINE))
    assert len(used) > 15
    assert {name for name in used if f"`{name}`" not in page} == set()


@pytest.mark.parametrize("out", ["--out", "--csv"])
def test_a_file_without_reports_leaves_nothing_and_says_why(bridge, out):
    status, made_there, said = bridge(b"no reports at all\r\n" * 5, out=out)
    assert status == 3
    assert "could be used as reports" in said.err
    assert f"{made_there}: not written" in said.out
    assert not made_there.exists()
