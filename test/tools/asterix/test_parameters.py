"""What the bridge finds out of recordings, and how a tracker takes it."""

import contextlib
import io

import asterix_records as made
import numpy as np
import pyproj
import pytest
from topocentric import seen_from

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.asterix import writing as plots_out
from phd_jdtc_ros.asterix.messages import DAY, NONE, PRIMARY, SECONDARY, Plot
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.tuning.findings import TuningError, findings
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.report import load
from phd_jdtc_ros.report.page import words
from phd_jdtc_ros.report.page.picture import picture_of
from phd_jdtc_ros.tools.asterix import parameters

NS = 10**9
GEOD = pyproj.Geod(ellps="WGS84")


def _too_few(plots):
    raise TuningError("too few tracks")


@pytest.fixture(scope="module", autouse=True)
def _short_estimation():
    """Leave out the estimation of noise: it takes seconds, and there are too few tracks for it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parameters, "findings", _too_few)
        yield


@pytest.fixture
def bridged(tmp_path, capsys):
    """Return a function that bridges data, and returns status, bag, output and parameters."""

    def start(data, *arguments, out="out"):
        path = tmp_path / "recording.ast"
        path.write_bytes(data)
        status = run("asterix_bridge", [str(path), "--out", str(tmp_path / out), *arguments])
        given = bag_parameters.read(tmp_path / out)
        return status, tmp_path / out, capsys.readouterr(), given

    return start


def sweep(
    seconds,
    rotation_s,
    targets,
    seed=0,
    begin_s=1000.0,
    each=10,
    radar=0x0102,
    code=NONE,
    height=np.nan,
):
    """Return times, and plots by data blocks of some, of targets that stand at azimuths and ranges.

    `targets` are pairs of azimuth (revolutions) and range (m).
    """
    rng = np.random.default_rng(seed)
    revolutions = np.arange(int(seconds / rotation_s) + 1)
    seen = []
    for part, far in targets:
        times = begin_s + (revolutions + part) * rotation_s
        jitter = rng.normal(0.0, 1e-3, len(revolutions))
        kind = PRIMARY if code == NONE else SECONDARY
        seen += [
            (
                round(time_s * NS),
                Plot(
                    *(radar, NONE, DAY, far, 2.0 * np.pi * (part + off), height),
                    *(code, NONE, kind, np.nan, np.nan),
                ),
            )
            for time_s, off in zip(times, jitter, strict=True)
        ]
    seen.sort(key=lambda entry: entry[0])
    blocks = [seen[k : k + each] for k in range(0, len(seen), each)]
    return seen, b"".join(block for group in blocks for block in plots_out.plot_blocks(group))


def targets(count, farthest, seed=0):
    rng = np.random.default_rng(seed)
    return [
        *zip(rng.uniform(0.0, 1.0, count), rng.uniform(0.1, 1.0, count) * farthest, strict=True)
    ]


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """Return a bag of primary plots of an unknown place, what was printed, and the parameters."""
    directory = tmp_path_factory.mktemp("bare")
    _, data = sweep(60.0, 4.0, targets(8, 100e3))
    (directory / "recording.ast").write_bytes(data)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        run("asterix_bridge", [str(directory / "recording.ast"), "--out", str(directory / "bag")])
    bag = directory / "bag"
    return bag, printed.getvalue(), bag_parameters.read(bag)


def times_of(bag, topic):
    """Return the times of all detections of a bag, seconds of the day."""
    config = from_arguments.config_of(bag_parameters.read(bag))
    (radar,) = (each for each in config.inputs if each.topic == topic)
    reports = [reader_of(radar).from_cdr(e.data, radar) for e in BagReader(bag).messages([topic])]
    assert not any(report.dropped for report in reports)
    found = [report.stamp_ns * 1e-9 + report.detections.time_s for report in reports]
    return np.sort(np.concatenate(found))


def test_radar_without_crossings_is_found_out(bridged):
    seen, data = sweep(160.0, 4.0016, targets(6, 200e3))
    status, bag, said, given = bridged(data)
    assert status == 0
    assert given["radar_1_2.rotation_s"] == pytest.approx(4.0016, abs=1e-4)
    assert given["interval_s"] == given["radar_1_2.rotation_s"]
    assert given["radar_1_2.sectors"] == 0
    assert "radar_1_2.fields.sector" not in given
    first = next(iter(BagReader(bag).messages()))
    cloud = interfaces.decode(first.data, names.CLOUD)
    assert "sector" not in {field.name for field in cloud.fields}
    assert "late_plots" not in said.out
    # No time was changed, but for the unit of the message and that of the cloud.
    expected = np.sort([time_ns / NS for time_ns, _ in seen])
    np.testing.assert_allclose(times_of(bag, "/radar_1_2/detections"), expected, atol=0.004)


def test_late_plots_and_a_wrong_clock_are_found_out(bridged):
    # Received 0.3 s after the crossing of their sector, by a clock 1581 s ahead.
    width_s, off_s = 12.0 / 32.0, 1581.0
    packets = []
    for k in range(32 * 20):
        begin_s = 1000.0 + k * width_s
        end_s = begin_s + width_s
        crossing = made.sector((k + 1) % 32 * 11.25, end_s)
        azimuth = (k % 32 + 0.5) * 11.25
        plots = made.plots(made.plot(azimuth, begin_s + 0.5 * width_s, range_nm=200.0))
        packets += [(end_s, crossing), (end_s + 0.3, plots)]
    packets.sort(key=lambda packet: packet[0])
    data = made.pcap([(round((t + off_s) * NS), made.packet(block)) for t, block in packets])
    status, bag, said, given = bridged(data)
    assert status == 0
    assert "; clock_off 1\n" in said.out  # There are no late plots
    assert "its clock is -1581" in said.out
    assert given["radar_1_2.rotation_s"] == given["interval_s"] == pytest.approx(12.0, abs=1e-3)
    assert given["radar_1_2.sectors"] == 32
    assert given["radar_1_2.fields.sector"] == "sector"
    assert given["lag_s"] == pytest.approx(60.0, abs=0.01)
    assert BagReader(bag).counts["/radar_1_2/detections"] >= 32 * 20 - 1


def test_ranges_follow_the_plots(bridged):
    _, data = sweep(60.0, 4.0, [(0.1, 300.0), (0.5, 400e3)])
    _, _, _, given = bridged(data)
    assert 400e3 * 1.1 <= given["radar_1_2.max_range"] <= 400e3 * 1.3
    assert given["radar_1_2.clutter_max_range"] == given["radar_1_2.max_range"]
    assert given["radar_1_2.min_range"] <= 300.0
    assert "detection" in given["radar_1_2.learn"]
    ranges = given["radar_1_2.detection_probability_range"]
    assert ranges[-1] == pytest.approx(given["radar_1_2.max_range"], abs=1.0)


def test_fields_are_those_that_plots_have_and_what_was_found_has_a_comment(bare, bridged):
    _, known = sweep(60.0, 4.0, targets(8, 100e3), code=0o1234, height=3000.0)
    _, _, given = bare
    assert not {"radar_1_2.fields.code", "radar_1_2.fields.height"} & {*given}
    assert "equipped_probability" not in given
    _, bag, _, given = bridged(known, out="known")
    assert given["radar_1_2.fields.code"] == "code"
    assert given["radar_1_2.fields.height"] == "height"
    assert "radar_1_2.fields.address" not in given
    assert given["equipped_probability"] == 0.99
    lines = (bag / bag_parameters.NAME).read_text().splitlines()
    commented = {line.split(":")[0].strip() for line in lines if " # " in line}
    assert commented >= {
        *("world_origin", "geodetic", "rotation_s", "sectors", "max_range", "min_range"),
        *("height", "code", "lag_s", "interval_s", "equipped_probability"),
    }


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_clutter_does_not_count_as_aircraft_without_a_transponder(bridged, monkeypatch, share):
    monkeypatch.setattr(parameters, "findings", findings)
    rng, count = np.random.default_rng(6), 30
    place, velocity = rng.uniform(-80e3, 80e3, (count, 2)), rng.normal(0.0, 150.0, (count, 2))
    plots = []
    for revolution in range(60):
        found = np.flatnonzero(rng.random(count) < 0.95)
        east, north = (place + 4.0 * revolution * velocity)[found].T
        far = np.hypot(east, north) + rng.normal(0.0, 30.0, len(found))
        azimuth = np.arctan2(east, north) + rng.normal(0.0, 1e-3, len(found))
        replies = (found < share * count) & (rng.random(len(found)) < 0.95)
        code = np.where(replies, 64 + found, NONE)
        clutter = rng.uniform([5e3, 0.0], [1e5, 6.28], (25, 2))
        for distance, angle, own in [
            *zip(far, np.remainder(azimuth, 2.0 * np.pi), code, strict=True),
            *((*each, NONE) for each in clutter),
        ]:
            kind = PRIMARY if own == NONE else SECONDARY
            plot = Plot(
                *(0x0102, NONE, DAY, distance, angle, np.nan),
                *(int(own), NONE, kind, np.nan, np.nan),
            )
            plots.append((round((1000.0 + 4.0 * (revolution + angle / (2.0 * np.pi))) * NS), plot))
    plots.sort(key=lambda entry: entry[0])
    blocks = [plots_out.plot_blocks(plots[k : k + 10]) for k in range(0, len(plots), 10)]
    _, _, _, given = bridged(b"".join(block for group in blocks for block in group))
    assert given["equipped_probability"] == pytest.approx(share, abs=0.05)


def test_noise_is_of_detections_whenever_they_come(bridged, monkeypatch):
    _, quiet = sweep(400.0, 4.0, targets(1, 100e3))
    _, _, said, given = bridged(quiet, out="quiet")
    assert "noise cannot be estimated from 101 plots in 0 tracks; that of" in said.out
    assert (given["radar_1_2.azimuth_std_deg"], given["radar_1_2.learn"][0]) == (0.08, "noise")
    monkeypatch.setattr(parameters, "findings", findings)
    _, busy = sweep(240.0, 4.0, targets(12, 100e3, seed=3), begin_s=1404.0)
    _, _, said, given = bridged(quiet + busy)
    assert "cannot be estimated" not in said.out
    assert given["radar_1_2.azimuth_std_deg"] == pytest.approx(0.36, rel=0.1)


def test_unknown_position_is_guessed_and_reported_and_the_bag_is_tracked(bare, tmp_path, capsys):
    bag, printed, given = bare
    assert given["world_origin"] == given["radar_1_2.geodetic"] == [0.0]
    assert "the position of radar_1_2 is unknown" in printed
    tracked, csv = tmp_path / "tracked", tmp_path / "tracks.csv"
    assert run("track_bag", [str(bag), "--out", str(tracked), "--csv", str(csv)]) == 0
    assert "latitudes and longitudes are left out" in capsys.readouterr().err
    rows = csv.read_text().splitlines()
    columns = rows[0].split(",")
    assert len(rows) > 1
    for name, is_known in {"x": True, "latitude": False, "longitude": False}.items():
        assert all(bool(row.split(",")[columns.index(name)]) == is_known for row in rows[1:])
    assert names.fixes() not in BagReader(tracked).types
    arguments = [str(bag), "--out", str(tmp_path / "other"), "--geojson", str(tmp_path / "g")]
    assert run("track_bag", arguments) == 2
    assert "--geojson: given without world_origin" in capsys.readouterr().err
    record = load.record(tracked, from_arguments.config_of(given))
    page = picture_of(record)
    assert "earth" not in page.header
    assert "position is unknown" in words.section(page.header)


def test_given_or_reported_position_is_used(bridged):
    _, data = sweep(60.0, 4.0, targets(8, 100e3))
    names_ = ["-p", "radars:=[a]", "-p", "a.source:=[1, 2]"]
    _, _, said, given = bridged(data, *names_, "-p", "a.geodetic:=[50.0, 8.0, 90.0]", out="given")
    assert given["a.geodetic"] == [50.0, 8.0, 90.0]
    assert given["world_origin"] == [50.0, 8.0, 0.0]
    assert "is unknown" not in said.out
    _, _, said, given = bridged(made.site(48.5, 11.25, 450.0) + data, out="said")
    assert given["radar_1_2.geodetic"] == pytest.approx([48.5, 11.25, 450.0], abs=1e-4)
    assert "is unknown" not in said.out


def test_radars_of_unknown_places_are_not_tracked_together(bridged, tmp_path):
    _, one = sweep(60.0, 4.0, targets(8, 100e3))
    _, other = sweep(60.0, 5.0, targets(4, 100e3), radar=0x0103)
    _, bag, said, given = bridged(one + other)
    assert given["sensors"] == ["radar_1_2"]
    assert "radar_1_3: not tracked, because its position is unknown or too far" in said.out
    assert "    # radar_1_3:" in (bag / bag_parameters.NAME).read_text()


@pytest.mark.parametrize(("seconds", "tuned"), [(8.0, False), (120.0, True)])
def test_surface_radar_is_over_a_flat_earth_with_speeds_of_its_own(
    bridged, monkeypatch, seconds, tuned
):
    # A revolution takes 1 s and has about 5 plots.
    monkeypatch.setattr(parameters, "findings", findings)
    _, data = sweep(seconds, 1.008, targets(5, 3000.0))
    _, bag, said, given = bridged(data)
    assert given["radar_1_2.max_range"] < 5000.0
    assert "world_origin" not in given
    assert given["radar_1_2.rotation_s"] == pytest.approx(1.008, abs=0.01 / seconds)
    assert ("are for a long-range radar and may not fit" in said.out) == (not tuned)
    assert (given["detection_births.std"][0] < 100.0) == tuned
    assert (given["cv.noise_density"] < 0.1) == tuned
    assert BagReader(bag).counts["/radar_1_2/detections"] <= 4 * 121


@pytest.mark.parametrize("latitude", [-60.0, 35.0, 70.0])
def test_guessed_place_gives_the_ground_ranges_of_the_true_one(bridged, latitude):
    # Aircraft at 11 km, all azimuths, as PROJ sees them from where the radar stands.
    place = (latitude, 8.0, 0.0)
    turned = np.arange(0.0, 1.0, 0.05)
    far = np.linspace(20e3, 300e3, len(turned))
    longitude, north, _ = GEOD.fwd(
        *(np.full(len(far), place[1]), np.full(len(far), place[0])), 360.0 * turned, far
    )
    east, ahead, up = seen_from(*place).transform(longitude, north, np.full(len(far), 11e3))
    slant = np.sqrt(east**2 + ahead**2 + up**2)
    _, data = sweep(20.0, 4.0, [*zip(turned, slant, strict=True)], code=1, height=11e3, each=1)
    _, bag, _, given = bridged(data)
    config = from_arguments.config_of(given)
    (radar,) = config.inputs
    found = [
        reader_of(radar).from_cdr(entry.data, radar).detections
        for entry in BagReader(bag).messages()
    ]
    ground, azimuth = np.concatenate([each.measurement for each in found]).T
    compass = (0.25 - azimuth / (2.0 * np.pi)) % 1.0
    number = np.round(compass / 0.05).astype(int) % len(turned)
    plane = SystemPlane(place)
    true = np.hypot(*plane.to_plane(north, longitude))[number]
    # Steps of 1/256 NM in range, and 11 km up at 20 km the effect is large.
    np.testing.assert_allclose(ground, true, atol=8.0)
