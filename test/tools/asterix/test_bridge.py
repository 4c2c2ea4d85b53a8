import bz2
import csv
import gzip
import io
import lzma
import zipfile
from functools import partial
from pathlib import Path

import asterix_records as made
import lz4.frame
import numpy as np
import pytest

from msg_adapters.encoding import interfaces, names, point_cloud
from msg_adapters.incoming import self_reports
from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments

ROOT = Path(__file__).parents[3]
TOPIC = "/radar_1_2/detections"
DAY_NS = 20_779 * 86_400 * 10**9
# A plot with an impossible length of the field SP.
BROKEN = b"\x30\x00\x0a\x81\x01\x01\x02\x01\x02\x00"
SEEN = [(10.0, 20.0), (100.0, 30.0), (190.0, 40.0), (350.0, 50.0)]


@pytest.fixture
def bridge(tmp_path, capsys):
    """Return a function that bridges data into a new bag and returns status, bag and output."""

    def start(data, *arguments, out="out"):
        path = tmp_path / "recording.ast"
        if data is not None:
            path.write_bytes(data)
        given = [str(path), "--out", str(tmp_path / out), *arguments]
        status = run("asterix_bridge", given)
        return status, tmp_path / out, capsys.readouterr()

    return start


def reports(bag, topic=TOPIC):
    """Return what a tracker with the parameters beside the bag reads of it, on a flat earth."""
    given = bag_parameters.read(bag)
    flat = {k: v for k, v in given.items() if not k.endswith(("world_origin", ".geodetic"))}
    config = from_arguments.config_of(flat)
    (radar,) = (each for each in config.inputs if each.topic == topic)
    entries = BagReader(bag).messages([topic])
    return [reader_of(radar).from_cdr(entry.data, radar) for entry in entries]


def test_recording_becomes_a_bag_that_a_tracker_reads(bridge):
    data = b"".join(made.revolutions(3, seen=SEEN))
    status, out, said = bridge(data, "--date", "2026-11-22")
    assert status == 0
    assert said.err == ""
    assert said.out.splitlines() == [
        f"{out}: 96 clouds, 12 plots",
        "radar_1_2: 12 plots, 97 service messages, 96 clouds, a revolution of 4.0000 s",
        "left out: none",
        "the position of radar_1_2 is unknown: shapes and distances are right on the round earth, "
        "but there are no latitudes and longitudes; set radar_1_2.geodetic and world_origin",
        "radar_1_2: its noise cannot be estimated from 12 plots in 0 tracks; that of the profile "
        "air_traffic is used",
    ]
    found = reports(out)
    assert [report.stamp_ns - DAY_NS for report in found] == [
        (1000 + (k + 1) / 8.0) * 10**9 for k in range(96)
    ]
    assert not any(report.dropped or report.anomalies["sectors_unusable"] for report in found)
    seen = [report for report in found if len(report.detections)]
    assert [report.sector for report in seen] == [7, 31, 23, 8] * 3
    distance, azimuth = np.concatenate([report.detections.measurement for report in seen]).T
    np.testing.assert_allclose(distance, np.tile([20, 30, 40, 50], 3) * 1852.0, rtol=1e-6)
    expected = np.tile([80.0, -10.0, -100.0, 100.0], 3)
    np.testing.assert_allclose(np.degrees(azimuth), expected, atol=0.01)
    times = [report.stamp_ns * 1e-9 + report.detections.time_s[0] for report in seen[:4]]
    true = [DAY_NS * 1e-9 + 1000.0 + each / 90.0 for each, _ in SEEN]
    np.testing.assert_allclose(times, true, atol=1 / 128)


def test_slices_between_sectors_have_the_field_of_the_sectors(bridge):
    parts = [
        *made.revolutions(2, seen=SEEN),
        *map(made.plots, [made.plot(90.0, 1030.0 + k) for k in range(9)]),
    ]
    status, out, _ = bridge(b"".join(parts))
    assert status == 0
    found = reports(out)
    assert sum(report.sector is None and len(report.detections) > 0 for report in found) > 3
    assert not any(report.anomalies["sector_missing"] for report in found)
    assert not any(report.anomalies["sectors_unusable"] for report in found)


def test_identities_heights_and_kinds_are_in_the_clouds(bridge):
    known = made.plot(5.0, 1000.06, i070=(0, 0, 0, 0, 0o7700), i090=(0, 0, -40), i220=0xABCDEF)
    bare = made.plot(6.0, 1000.07)
    parts = [*made.revolutions(1)]
    status, out, _ = bridge(b"".join([parts[0], made.plots(known, bare), *parts[1:]]))
    assert status == 0
    found = reports(out)[0].detections
    assert found.code.tolist() == [0o7700, -1]
    assert found.address.tolist() == [0xABCDEF, -1]
    assert found.detection_type.tolist() == [3, 3]
    np.testing.assert_allclose(found.height, [-304.8, np.nan], rtol=1e-6)
    (first, *_) = BagReader(out).messages([TOPIC])
    cloud = interfaces.decode(first.data, names.CLOUD)
    kinds = [(field.offset, field.datatype) for field in cloud.fields if field.name == "kind"]
    assert [bytes(cloud.data)[offset] for offset, _ in kinds] == [3]
    assert [datatype for _, datatype in kinds] == [2]


def test_csv_has_every_plot_as_a_row_without_a_bag(tmp_path, capsys):
    known = made.plot(
        5.0, 1000.06, i070=(0, 0, 0, 0, 0o7700), i090=(0, 0, -40), i220=0xABCDEF, i240="KLM123  "
    )
    bare = made.plot(359.0, 1003.99)
    blocks = [*made.revolutions(1)]
    path, out = tmp_path / "recording.ast", tmp_path / "plots.csv"
    path.write_bytes(b"".join([blocks[0], made.plots(known), *blocks[1:], made.plots(bare)]))
    given = [str(path), "--csv", str(out), "--date", "2026-11-22"]
    assert run("asterix_bridge", given) == 0
    assert capsys.readouterr().out.startswith(f"{out}: 32 clouds, 2 plots\n")
    with out.open(newline="") as file:
        first, second = csv.DictReader(file)
    seconds = DAY_NS // 10**9
    assert float(first.pop("time")) == pytest.approx(seconds + 1000.06, abs=1 / 128)
    assert float(second.pop("time")) == pytest.approx(seconds + 1003.99, abs=1 / 128)
    assert float(first["range"]) == pytest.approx(float(second["range"]))
    assert float(first.pop("azimuth")) == pytest.approx(5.0, abs=0.006)
    assert float(second.pop("azimuth")) == pytest.approx(359.0, abs=0.006)
    assert first.pop("range") == second.pop("range")
    own = {"height": "-304.80", "mode_3a": "7700", "mode_s": "ABCDEF", "call_sign": "KLM123"}
    assert first == {"radar": "radar_1_2", "amplitude_dbm": "", "detection_type": "3", **own}
    assert second == {**first, **dict.fromkeys(own, "")}
    # An existing table stays.
    assert run("asterix_bridge", given) == 2
    assert "already exists" in capsys.readouterr().err


def test_csv_has_the_plots_of_the_bag_in_their_order(bridge, tmp_path):
    data = b"".join(made.revolutions(3, seen=SEEN))
    _, out, _ = bridge(data)
    table = tmp_path / "plots.csv"
    assert run("asterix_bridge", [str(tmp_path / "recording.ast"), "--csv", str(table)]) == 0
    rows = np.genfromtxt(table, delimiter=",", names=True, usecols=("range", "azimuth"))
    found = [report.detections for report in reports(out) if len(report.detections)]
    distance, azimuth = np.concatenate([each.measurement for each in found]).T
    np.testing.assert_allclose(rows["range"], distance, atol=0.01)
    np.testing.assert_allclose(rows["azimuth"], (90.0 - np.degrees(azimuth)) % 360.0, atol=1e-3)


@pytest.mark.parametrize(("source", "status"), [("bag", 2), ("empty", 3), ("text", 2)])
def test_csv_of_what_is_no_recording_is_refused(tmp_path, capsys, source, status):
    path, out = tmp_path / "recording.ast", tmp_path / "plots.csv"
    path.write_bytes(b"" if source == "empty" else b"no recording at all")
    if source == "bag":
        path = ROOT / "bags" / "paper_scenario"
    found = run("asterix_bridge", [str(path), "--csv", str(out)])
    assert (found, out.exists()) == (status, False), capsys.readouterr()


@pytest.mark.parametrize("kind", ["final", "pcap", "pcapng"])
def test_framings_of_one_recording_give_the_same_bag(bridge, kind):
    blocks = [*made.revolutions(2, seen=SEEN)]
    _, plain, _ = bridge(b"".join(blocks), "--date", "2026-11-22", out="plain")
    if kind == "final":
        data = b"".join(made.final(block, 1000.0 + k / 8.0) for k, block in enumerate(blocks))
    else:
        times = [DAY_NS + round((1000.0 + k / 8.0) * 1e9) for k in range(len(blocks))]
        data = getattr(made, kind)([*zip(times, map(made.packet, blocks), strict=True)])
    status, out, said = bridge(data, "--date", "2026-11-22", out="plain_of_frames")
    assert status == 0
    assert "left out: none" in said.out
    one, other = (
        [(entry.topic, entry.log_time_ns, entry.data) for entry in BagReader(bag).messages()]
        for bag in (plain, out)
    )
    assert one == other


def test_radars_are_named_and_turned_by_the_parameters(bridge):
    data = b"".join(
        part
        for pair in zip(
            made.revolutions(2, sic=1, seen=SEEN),
            made.revolutions(2, sic=9, seen=SEEN),
            strict=True,
        )
        for part in pair
    )
    given = ["-p", "radars:=[a, b]", "-p", "a.source:=[1, 1]", "-p", "b.source:=[1, 9]"]
    given += ["-p", "b.sectors:=16", "-p", "a.geodetic:=[50.0, 8.0, 100.0]"]
    given += ["-p", "b.geodetic:=[50.5, 8.5, 120.0]"]
    status, out, said = bridge(data, *given)
    assert status == 0
    assert "a: 8 plots, 65 service messages, 64 clouds" in said.out
    assert BagReader(out).counts == {"/a/detections": 64, "/b/detections": 32}
    config = from_arguments.config_of(bag_parameters.read(out))
    assert [radar.sectors for radar in config.inputs] == [32, 16]
    sites = [radar.site.geodetic for radar in config.inputs]
    assert sites == [(50.0, 8.0, 100.0), (50.5, 8.5, 120.0)]


def test_only_a_port_of_a_capture_is_read_where_asked(bridge):
    blocks = [*made.revolutions(1, seen=[(100.0, 30.0)])]
    packets = [(k * 10**8, made.packet(block)) for k, block in enumerate(blocks)]
    packets += [(k * 10**8, made.packet(block, port=9)) for k, block in enumerate(blocks)]
    # Recordings without ports are read whatever is asked.
    final = b"".join(made.final(block, 1000.0 + k / 8.0) for k, block in enumerate(blocks))
    for data, left_out in ((made.pcap(sorted(packets)), "other_port 34"), (final, "none")):
        given = ("--port", "8600", "-p", "sectors:=8")
        status, out, said = bridge(data, *given, out=left_out[:4])
        assert status == 0
        assert f"left out: {left_out}" in said.out
        assert BagReader(out).counts == {TOPIC: 8}


@pytest.mark.parametrize(("ports", "expected"), [([9], 3), ([9, 8600], 0)])
def test_port_without_datagrams_is_named_with_those_that_have_some(bridge, ports, expected):
    blocks = made.revolutions(1, seen=SEEN)
    packets = [(k * 10**8, made.packet(block)) for k, block in enumerate(blocks)]
    words = [word for port in ports for word in ("--port", str(port))]
    status, _, said = bridge(made.pcap(packets), *words)
    silence = "no datagram is to port 9; ports with their datagrams: 8600 (37)"
    assert status == expected
    assert (said.err if expected else said.out).count(silence) == 1
    assert said.err.count("\n") == (1 if expected else 0)


def test_wrong_source_is_reported_with_the_radars_of_the_recording(bridge):
    data = b"".join(made.revolutions(1))
    status, _, said = bridge(data, "-p", "radars:=[a]", "-p", "a.source:=[9, 9]")
    assert status == 3
    assert said.err.endswith("left out: unknown_radar 33; SAC/SIC of unknown radars: 1/2 (33)\n")


def test_capture_without_datagrams_has_no_data_blocks(bridge):
    status, _, said = bridge(made.pcap([]))
    assert status == 3
    assert said.err.endswith(": has no data blocks of ASTERIX\n")


def test_packets_that_were_not_captured_whole_are_no_success(bridge):
    blocks = made.revolutions(4, seen=SEEN)
    packets = [(round(k * 1e9 / 8.0), made.packet(block)) for k, block in enumerate(blocks)]
    # The last packet has the length that it was sent with, and four bytes less.
    data, size = bytearray(made.pcap(packets)), len(packets[-1][1])
    data[-size - 8 : -size - 4] = (size - 4).to_bytes(4, "little")
    status, _, said = bridge(bytes(data[:-4]))
    assert status == 3
    assert "has 1 packet that was not captured whole, and is left out: tcpdump -s 0" in said.err


@pytest.mark.parametrize("given", ["0", "65536", "-1", "8600x", "9" * 5000])
def test_impossible_port_is_refused(bridge, given, capsys):
    with pytest.raises(SystemExit, match="2"):
        bridge(b"", f"--port={given}")
    assert "must be a port from 1 to 65535" in capsys.readouterr().err


def test_wrong_clock_and_second_source_are_reported(bridge):
    blocks = [*made.revolutions(1, start_s=1000.0, seen=[(359.0, 30.0)])]
    packets = []
    for k, block in enumerate(blocks):
        time_ns = round((2000.0 + min(k, 32) / 8.0) * 1e9)
        packets.append((time_ns, made.packet(block)))
        packets.append((time_ns, made.packet(block, sender="10.0.0.2")))
    status, _, said = bridge(made.pcap(packets))
    assert status == 0
    assert "radar_1_2: its clock is -1000.0 s off, and was shifted" in said.out
    assert (
        "radar_1_2: messages of two sources, 10.0.0.1 to 239.1.1.1:8600 and 10.0.0.2 to "
        "239.1.1.1:8600: messages of the second are left out"
    ) in said.out


@pytest.mark.parametrize(("elsewhere", "expected"), [(0, 0), (1, 0), (2, 3)])
def test_two_radars_of_one_number_are_told_by_their_places(bridge, elsewhere, expected):
    seen = [(azimuth, 20.0) for azimuth in range(5, 360, 23)]
    blocks = [made.site(50.0, 8.0, 100), *made.revolutions(1, seen=seen)]
    blocks += [made.site(49.9, 8.5, 90)] * elsewhere
    status, _, said = bridge(b"".join(blocks))
    assert status == expected
    told = "radar_1_2 is at 50.0000, 8.0000 first and in 2 messages elsewhere, such as 49.9"
    assert (told in said.err) == bool(expected)


def tracks(count):
    """Return data blocks of CAT062, each of one record with SAC and SIC only."""
    return [b"\x3e" + (6).to_bytes(2, "big") + b"\x80\x01\x02"] * count


def test_recording_of_tracks_alone_fails_with_its_contents(bridge):
    status, _, said = bridge(b"".join(tracks(20)))
    assert status == 3
    assert "0 of 20 positions could be used; all records: CAT062 20; left out: no_posi" in said.err


@pytest.mark.parametrize(("broken", "expected"), [(14, 0), (18, 3)])
def test_recording_of_which_less_than_half_of_the_plots_can_be_used_fails(bridge, broken, expected):
    # The recording has 16 plots, and ten times as many tracks of another tracker without a place,
    # which do not count.
    seen = [(azimuth, 20.0) for azimuth in range(5, 360, 23)]
    data = b"".join([*made.revolutions(1, seen=seen), *[BROKEN] * broken, *tracks(160)])
    status, out, said = bridge(data)
    assert status == expected
    assert (f"16 of {16 + broken} plots could be used" in said.err) == bool(expected)
    assert "no_position 160" in said.out
    # The usable records are there.
    assert BagReader(out).counts == {TOPIC: 32}


def without_times(data):
    """Return plots without the time I048/140."""
    return made.plots({k: v for k, v in made.plot(10.0, 5.0).items() if k != "140"}) * data


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"".join(made.revolutions(1)), "has no plots; 33 of 33 records could be used"),
        (
            b"".join([*made.revolutions(1), BROKEN * 9]),
            "0 of 9 plots could be used; all records: CAT034 33, CAT048 9; left out: "
            "explicit_length 9",
        ),
        (
            without_times(7),
            "0 of 7 plots could be used: no message has a time, its own or that of its receipt",
        ),
    ],
    ids=["service messages only", "malformed plots", "no times"],
)
def test_recording_of_which_no_plot_can_be_used_fails_with_the_reason(bridge, data, expected):
    status, _, said = bridge(data)
    assert status == 3
    assert f"recording.ast: {expected}" in said.err
    assert " 0 plots" in said.out
    assert "sees 0.0 km" not in said.out


def test_foreign_categories_are_counted_and_skipped_by_their_length(bridge):
    parts = [*made.revolutions(2, seen=SEEN)]
    _, plain, _ = bridge(b"".join(parts), out="plain")
    foreign = [bytes([category, 0, 9]) + bytes(6) for category in (4, 16, 30, 129, 240, 253)]
    data = b"".join(part + foreign[k % 6] for k, part in enumerate(parts))
    status, out, said = bridge(data, out="plain_of_other_files")
    assert status == 0
    assert said.err == ""
    assert "skipped: CAT004 13, CAT016 12, CAT030 12, CAT129 12, CAT240 12, CAT253 12\n" in said.out
    one, other = (
        [(entry.topic, entry.log_time_ns, entry.data) for entry in BagReader(bag).messages()]
        for bag in (plain, out)
    )
    assert one == other


def zipped(data, files=("recording.ast",)):
    """Return an archive of these files, all with the same data."""
    with io.BytesIO() as stream:
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("tower/", "")
            for name in files:
                archive.writestr(f"tower/{name}", data)
        return stream.getvalue()


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress, lzma.compress, zipped])
def test_packed_recording_is_unpacked(bridge, pack):
    status, out, said = bridge(pack(b"".join(made.revolutions(2, seen=SEEN))))
    assert (status, said.err) == (0, "")
    assert "left out: none" in said.out
    assert BagReader(out).counts[TOPIC] > 20


@pytest.mark.parametrize("pack", [gzip.compress, partial(lzma.compress, preset=0)])
def test_packed_recording_is_used_up_to_its_damage(bridge, pack):
    status, out, said = bridge(pack(b"".join(made.revolutions(2, seen=SEEN)))[:-20])
    assert BagReader(out).counts[TOPIC] > 20
    assert (status, "cannot be unpacked to its end" in said.err) == (3, True)


@pytest.mark.parametrize(
    ("pack", "said"),
    [
        (lambda data: zipped(data)[:-20], "is damaged: nothing can be unpacked"),
        (lambda data: bz2.compress(data)[:-20], "is damaged: nothing can be unpacked"),
        (lambda data: zipped(data, "ab"), "is a zip archive of 2 files, must be of one"),
        (lz4.frame.compress, "is packed by lz4, must be unpacked before"),
    ],
)
def test_packed_recording_that_cannot_be_used_says_why(bridge, pack, said):
    status, _, told = bridge(pack(b"".join(made.revolutions(2, seen=SEEN))))
    assert status
    assert said in told.err


def test_radar_of_a_single_message_beside_others_is_left_out(bridge):
    parts = [*made.revolutions(2, seen=SEEN)]
    stray = made.plots(made.plot(20.0, 1002.0, sic=77))
    status, out, said = bridge(b"".join([*parts[:20], stray, *parts[20:]]))
    assert status == 0
    assert "radar_1_77: a single message, which is left out" in said.out
    assert [*BagReader(out).counts] == [TOPIC]
    # Without others it is all there is.
    status, out, said = bridge(stray, out="alone")
    assert BagReader(out).counts == {"/radar_1_77/detections": 1}


def test_recording_whose_end_is_missing_is_used_and_fails(bridge):
    status, out, said = bridge(b"".join(made.revolutions(1, seen=SEEN))[:-3])
    assert status == 3
    assert "is damaged in 1 place: " in said.err
    assert BagReader(out).counts[TOPIC] > 0


def test_trailers_of_datagrams_are_reported_and_no_faults(bridge):
    blocks = [*made.revolutions(1, seen=SEEN)]
    packets = [
        (round((1000.0 + k / 8.0) * 1e9), made.packet(block + b"\xee\xff\0\1" + bytes([k] * 4)))
        for k, block in enumerate(blocks)
    ]
    status, _, said = bridge(made.pcap(packets))
    assert status == 0
    assert f"{len(blocks)} datagrams have a trailer of 8 bytes, which is skipped" in said.out
    assert "left out: none" in said.out


@pytest.mark.parametrize(
    ("data", "status", "fault"),
    [
        (b"", 3, "is empty, nothing was recorded"),
        (b"not a recording", 2, "is not a recording of ASTERIX"),
        (None, 2, "no such recording or bag"),
    ],
)
def test_what_is_no_recording_is_refused(bridge, data, status, fault):
    found, out, said = bridge(data)
    assert found == status
    assert f"recording.ast: {fault}" in said.err
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--date", "22.11.2026"], "22.11.2026 given, must be a date such as 2026-11-22"),
        (["-p", "sectors:=30"], "sectors: 30 given, must be a multiple of 4"),
        (["-p", "radars:=[a, b]"], "b.source: 0/0 given, a has it too"),
        (["-p", "sektors:=30"], "sektors: unknown parameter"),
    ],
)
def test_wrong_arguments_are_named(bridge, capsys, arguments, expected):
    try:
        status, _, said = bridge(b"x", *arguments)
        err = said.err
    except SystemExit as end:
        status, err = end.code, capsys.readouterr().err
    assert status == 2
    assert expected in err


def test_existing_bag_is_not_overwritten(bridge, tmp_path):
    (tmp_path / "out").mkdir()
    status, _, said = bridge(b"".join(made.revolutions(1)))
    assert status == 2
    assert "already exists" in said.err


def test_positions_and_tracks_become_sensors_beside_the_radar(bridge):
    place = (("LAT", 52.0), ("LON", 4.5))
    who = {"010": (("SAC", 9), ("SIC", 1))}
    blocks = [made.site(52.0, 4.5, 10.0)]
    for k, block in enumerate(made.revolutions(3, seen=SEEN)):
        blocks.append(block)
        time = made.ticks(1000.0 + k / 8)
        north = (("LAT", 52.1 + k * 1e-4), ("LON", 4.5))
        squitter = {"040": ((0, 0, 0, 0, None),), "071": time, "131": north, "080": 0x40621D}
        blocks.append(made.block(21, [{**who, **squitter}]))
        track = {"010": (("SAC", 9), ("SIC", 2)), "070": time, "105": place, "040": 7 + k}
        blocks.append(made.block(62, [track]))
    status, out, said = bridge(b"".join(blocks), "--date", "2026-11-22")
    assert (status, said.err) == (0, "")
    assert "adsb_9_1: " in said.out
    assert "positions, tracks of another centre, on /tracks_9_2/reports" in said.out
    counts = BagReader(out).counts
    assert counts["/adsb_9_1/reports"] > 5
    assert counts["/tracks_9_2/reports"] > 5
    config = from_arguments.config_of(bag_parameters.read(out))
    assert [each.name for each in config.radars] == ["radar_1_2"]
    beside = {each.name: (each.topic, each.identity) for each in config.receivers}
    assert beside == {
        "adsb_9_1": ("/adsb_9_1/reports", "icao"),
        "tracks_9_2": ("/tracks_9_2/reports", "number"),
    }
    columns = {"latitude": ("f8",), "address": ("u4",), "space": ("u1",)}
    (first, *_) = BagReader(out).messages(["/adsb_9_1/reports"])
    found = point_cloud.decode(interfaces.decode(first.data, names.CLOUD), columns)
    assert found["latitude"][0] == pytest.approx(52.1, abs=1e-6)
    assert (found["address"][0], found["space"][0]) == (0x40621D, 1)
    # The tracker's own reader takes them as they are.
    told = self_reports.from_cdr(first.data, config.receivers[0])
    assert not told.dropped
    assert told.reports.address[0] == 0x40621D
