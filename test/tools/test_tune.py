"""The command that proposes a configuration from a recording."""

import re
import shutil
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from bag_content import rewrite, write

from msg_adapters.encoding import interfaces, names, point_cloud, stamps
from msg_adapters.incoming import recognised
from phd_jdtc_ros import Tracker
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.bags.reader import BagError, BagReader
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.tools import recorded_plots

BAGS = Path(__file__).parents[2] / "bags"
SHIPPED = BAGS / "one_radar"
DRONES = SHIPPED.parent / "drones"
PROGRESS = re.compile(
    r"tune: reading .*\n"
    r"tune: radar_1, radar 1 of 1: estimating from \d+ detections\n"
    r"tune: done in \d+\.\d s\n"
)


def tune(*arguments):
    return run("tune", [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def unknown(tmp_path_factory):
    """Return a recording without parameters."""
    bag = tmp_path_factory.mktemp("bags") / "unknown"
    shutil.copytree(SHIPPED, bag)
    (bag / "parameters.yaml").unlink()
    return bag


def test_tune_proposes_what_was_simulated_in_a_file_that_the_tracker_takes(tmp_path, capsys):
    out = tmp_path / "proposed.yaml"
    assert tune("one_radar", "--out", out) == 0
    text, said = out.read_text(), capsys.readouterr()
    assert f"{out}: written; the tracker takes it as its --params-file" in said.out
    assert "range_std" in said.out
    assert PROGRESS.fullmatch(said.err)
    config = from_arguments.config_of(from_arguments.load(out))
    (radar,) = config.model.radars
    assert radar.range_std == pytest.approx(300.0, rel=0.2)
    assert config.values["radar_1.azimuth_std_deg"] == pytest.approx(1.0, rel=0.2)
    assert radar.clutter_rate == pytest.approx(20.0, rel=0.1)
    # All given parameters stay, such as birth places and SNR bands.
    assert config.values["north_west.position"] == [-8000.0, 6000.0]
    assert config.values["radar_1.detection_probability"] == 0.0
    (line,) = [line for line in text.splitlines() if "range_std:" in line]
    assert "tracks" in line
    assert "; was 300" in line


def test_tune_recognises_a_radar_by_its_fields(unknown, tmp_path, capsys):
    out = tmp_path / "proposed.yaml"
    assert tune(unknown, "--seconds", 120, "--out", out) == 0
    text = out.read_text()
    assert "no recording contains" in text
    # The default too, or a mirrored world would not show where it is from.
    (convention,) = [line for line in text.splitlines() if "azimuth_convention:" in line]
    assert convention.split(maxsplit=2)[1:] == ["enu_ccw", "# check it; compass_cw if north is 0"]
    config = from_arguments.config_of(from_arguments.load(out))
    (radar,), (layout,) = config.model.radars, config.inputs
    assert (layout.topic, layout.frame) == ("/radar_1/detections", "radar_1")
    assert (layout.fields.range, layout.fields.azimuth) == ("range", "azimuth")
    assert radar.range_std == pytest.approx(300.0, rel=0.2)
    assert config.values["interval_s"] == 6.0
    # It reads what it was made from.
    bag = BagReader(unknown)
    read = recorded_plots.read(bag, config, 60.0)
    assert not read.dropped["radar_1"]
    assert len(read.plots["radar_1"].cloud_s) == 11
    assert PROGRESS.fullmatch(capsys.readouterr().err)


def test_tune_keeps_what_it_proposed(unknown, tmp_path):
    first, second = tmp_path / "first.yaml", tmp_path / "second.yaml"
    assert tune(unknown, "--seconds", 120, "--out", first) == 0
    assert tune(unknown, "--seconds", 120, "--params-file", first, "--out", second) == 0
    assert from_arguments.load(first) == from_arguments.load(second)


def test_tune_says_if_it_uses_only_the_first_detections(monkeypatch, capsys):
    read = recorded_plots.read
    monkeypatch.setattr(recorded_plots, "read", lambda *given: read(*given, most=900))
    assert tune("one_radar") == 0
    (said,) = [line for line in capsys.readouterr().out.splitlines() if "detections are" in line]
    assert re.fullmatch(
        r"radar_1: the first 9\d\d of \d{4} detections are used, because more .*", said
    )


def test_tune_warns_of_clouds_that_come_twice_and_leaves_the_copies_out(tmp_path, capsys):
    def twice(entry):
        sent = interfaces.decode(entry[1], names.CLOUD)
        later_ns = entry[2] + 10**8
        sent.header.stamp = stamps.from_ns(later_ns)
        return [entry, (entry[0], interfaces.encode(sent), later_ns)]

    copied = rewrite(SHIPPED, tmp_path / "copied", twice, drop=["/ground_truth/targets"])
    shutil.copy(SHIPPED / "parameters.yaml", copied)
    assert tune(copied) == 0
    said = capsys.readouterr().out
    assert re.search(r"radar_1: \d+ clouds that repeat all detections of the cloud before", said)
    assert "detections are used" not in said


@pytest.mark.parametrize(
    "name", ["/n\x1b]0;owned\x07\x1b[2J/detections", "/n[/bold][red]/detections"]
)
def test_tune_prints_the_name_of_a_hostile_topic_and_does_not_obey_it(tmp_path, capsys, name):
    hostile = rewrite(
        SHIPPED,
        tmp_path / "hostile",
        lambda entry: [(name, *entry[1:])],
        drop=["/ground_truth/targets"],
        add=[(name, names.CLOUD, [])],
    )
    assert tune(hostile) == 0
    said = "".join(capsys.readouterr())
    assert not re.search(r"[\x00-\x09\x0b-\x1f]", said)
    assert ascii(name)[1:-1] in "".join(said.split("\n"))


def test_tune_reports_what_a_recording_lacks(short_bag, tmp_path, capsys):
    assert tune(short_bag) == 2
    said = capsys.readouterr().err
    assert "radar_1: 8 clouds in 42.0 s, must be at least 10" in said
    assert "radar_2: 8 clouds" in said
    assert tune(tmp_path / "none") == 2
    assert "no such bag" in capsys.readouterr().err


def test_tune_warns_of_a_unit_that_contradicts_the_recording(tmp_path, capsys):
    given = from_arguments.load(SHIPPED / "parameters.yaml")
    given["radar_1.units.azimuth"] = "deg"
    file = tmp_path / "degrees.yaml"
    document = {"/**/tracker": {"ros__parameters": given}}
    file.write_text(yaml.safe_dump(document))
    tune("one_radar", "--params-file", file)
    said = "".join(capsys.readouterr())
    assert "radar_1: all azimuths are within 6.3 degrees; probably radians" in said


def test_tune_uses_the_intact_part_of_a_damaged_bag_with_a_warning(tmp_path, capsys):
    (file,) = SHIPPED.glob("*.mcap")
    whole = file.read_bytes()
    shutil.copytree(SHIPPED, tmp_path / "cut")
    (tmp_path / "cut" / file.name).write_bytes(whole[: len(whole) * 3 // 4])
    out = tmp_path / "proposed.yaml"
    assert tune(tmp_path / "cut", "--out", out) == 3
    said = capsys.readouterr()
    assert "damaged" in said.err
    assert len(PROGRESS.sub("", said.err).splitlines()) == 1
    radar = from_arguments.config_of(from_arguments.load(out)).model.radars[0]
    assert radar.range_std == pytest.approx(300.0, rel=0.2)


def test_tune_overwrites_nothing(tmp_path, capsys):
    out = tmp_path / "mine.yaml"
    out.write_text("mine")
    assert tune("one_radar", "--out", out) == 2
    assert "already exists" in capsys.readouterr().err
    assert out.read_text() == "mine"


def test_tune_names_a_missing_directory_before_it_reads(tmp_path, capsys):
    out = tmp_path / "none" / "mine.yaml"
    assert tune("one_radar", "--out", out) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == f"tune: --out: {out} given, but {out.parent} is no directory\n"


def test_tune_names_the_fields_of_clouds_that_it_does_not_recognise(tmp_path, capsys):
    cloud = point_cloud.encode(10**9, "lidar", {"x": np.ones(3), "ring": np.ones(3)})
    write(tmp_path / "points", ["/lidar/points"], [("/lidar/points", cloud, 10**9)])
    assert tune(tmp_path / "points") == 2
    assert "it has /lidar/points (ring, x). Name them" in capsys.readouterr().err


@pytest.mark.parametrize("lost", ["all", "most"])
def test_tune_names_the_damage_that_leaves_it_too_little(tmp_path, lost, capsys):
    # The clouds of one chunk, which a wrong bit damages, or those that a cut leaves.
    rng = np.random.default_rng(2)
    clouds = [
        point_cloud.encode(k * 10**8 + 1, "lidar", {"x": 9.0 * rng.random(3), "y": rng.random(3)})
        for k in range(40)
    ]
    entries = [("/lidar/points", each, k * 10**8 + 1) for k, each in enumerate(clouds)]
    (file,) = write(tmp_path / "bag", ["/lidar/points"], entries).glob("*.mcap")
    data = bytearray(file.read_bytes())
    if lost == "all":
        data[len(data) // 2] ^= 0xFF
    else:
        del data[len(data) // 3 :]
    file.write_bytes(data)
    assert tune(tmp_path / "bag") == 3
    assert "damaged" in capsys.readouterr().err


# Recognition of fields.


def cloud(stamp_ns=10**18, wide=(), **columns):
    return point_cloud.encode(stamp_ns, "mast", columns, wide)


AZIMUTH = np.array([0.1, 1.5, 3.0, 5.0])
RHO = np.array([100.0, 200.0, 300.0, 400.0])


def test_names_are_recognised_whatever_their_case():
    assert recognised.parameters([cloud(X=RHO, vel_x=RHO)]) is None
    assert recognised.parameters([]) is None
    found = recognised.parameters([cloud(x=RHO, Y=RHO, vel_x=RHO, vel_y=RHO, x_std=RHO)])
    named = {"fields.y": "Y", "fields.vx": "vel_x", "fields.vy": "vel_y"}
    assert found == {"kind": "position", "frame": "mast", **named}
    # Tracks are no detections, and the points of all surfaces neither.
    assert recognised.parameters([cloud(x=RHO, y=RHO, track_id=RHO)]) is None
    many = np.linspace(0.0, 1.0, 2001)
    assert recognised.parameters([cloud(x=many, y=many)]) is None
    found = recognised.parameters([cloud(range_m=RHO, azimuth_deg=np.degrees(AZIMUTH))])
    assert (found["fields.range"], found["fields.azimuth"]) == ("range_m", "azimuth_deg")
    assert found["units.azimuth"] == "deg"
    found = recognised.parameters([cloud(range_km=RHO, azimuth_deg=AZIMUTH)])
    assert found is None  # Ranges are in metres
    found = recognised.parameters([cloud(Rho=RHO, THETA=AZIMUTH, SNR=RHO)])
    assert (found["fields.range"], found["fields.azimuth"]) == ("Rho", "THETA")
    assert (found["fields.amplitude"], found["units.amplitude"]) == ("SNR", "db")
    assert found["frame"] == "mast"


def test_unit_and_convention_are_those_that_go_with_x_and_y():
    north = 0.5 * np.pi - AZIMUTH
    place = {"x": RHO * np.cos(north), "y": RHO * np.sin(north)}
    found = recognised.parameters([cloud(**place, range=RHO, bearing=np.degrees(AZIMUTH))])
    assert (found["units.azimuth"], found["units.azimuth_convention"]) == ("deg", "compass_cw")
    found = recognised.parameters([cloud(range=RHO, bearing=np.degrees(AZIMUTH))])
    assert found["units.azimuth"] == "deg"
    assert "units.azimuth_convention" not in found


@pytest.mark.parametrize(("unit", "per_second"), [("s", 1.0), ("ms", 1e3), ("us", 1e6)])
def test_times_have_the_unit_that_puts_them_near_the_stamp(unit, per_second):
    since = np.array([0.0, 0.5, 1.5, 30.0]) * per_second
    found = recognised.parameters([cloud(range=RHO, azimuth=AZIMUTH, time=since)])
    assert (found["units.time"], found["units.time_reference"]) == (unit, "stamp")
    epoch = since + 1e9 * per_second
    found = recognised.parameters([cloud(wide=["t"], range=RHO, azimuth=AZIMUTH, t=epoch)])
    assert (found["units.time"], found["units.time_reference"]) == (unit, "epoch")


def test_times_and_elevations_are_recognised_by_their_values():
    since = np.array([0.0, 10.0, 20.0, 45.0])
    clouds = [
        cloud(10**18 + k * 50_000_000, range=RHO, azimuth=AZIMUTH, time=since) for k in range(4)
    ]
    assert recognised.parameters(clouds)["units.time"] == "ms"
    flat = recognised.parameters([cloud(range=RHO, azimuth=AZIMUTH, elevation=0.0 * RHO)])
    assert "fields.elevation" not in flat
    high = recognised.parameters([cloud(range=RHO, azimuth=AZIMUTH, elevation=0.1 + 0.0 * RHO)])
    assert high["fields.elevation"] == "elevation"
    assert "units.elevation" not in high
    up = np.array([2.0, 10.0, 40.0, np.nan])
    degrees = recognised.parameters([cloud(range=RHO, azimuth=AZIMUTH, elevation=up)])
    assert degrees["units.elevation"] == "deg"
    z = -RHO * np.sin(np.radians(up))
    sonar = recognised.parameters([cloud(range=RHO, azimuth=AZIMUTH, elevation=up, z=z)])
    assert sonar["units.elevation"] == "down_deg"
    small = recognised.parameters([cloud(range=RHO, azimuth=AZIMUTH, elevation=17.45 * up)])
    assert small["units.elevation"] == "mrad"


def flights_with_elevations(seen):
    """Return a table of eight flights; `seen` returns the sent values of elevations."""
    rng, rows = np.random.default_rng(9), []
    place, speed = rng.uniform(-1500.0, 1500.0, (8, 2)), rng.uniform(-15.0, 15.0, (8, 2))
    above = rng.uniform(150.0, 400.0, 8)
    for time in np.arange(0.0, 60.0, 0.5):
        x, y = (place + time * speed).T
        level, azimuth = np.hypot(x, y), np.arctan2(y, x)
        noise = rng.standard_normal((3, 8)) * [[2.0], [0.014], [0.017]]
        elevation = seen(np.arctan2(above, level) + noise[2])
        slant = np.hypot(level, above) + noise[0]
        rows += zip(np.full(8, time), slant, azimuth + noise[1], elevation, strict=True)
    return dict(zip(("time", "range", "azimuth", "elevation"), np.transpose(rows), strict=True))


@pytest.mark.parametrize(
    ("seen", "said"),
    [
        (lambda elevation: 0.5 * np.pi - elevation, "to zenith_rad or zenith_deg"),
        (lambda elevation: -elevation, "set radar.units.elevation to down_rad or down_deg"),
        (lambda elevation: elevation, ""),
    ],
)
def test_elevations_in_another_sense_are_named(seen, said):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        Tracker({"state": "space"}).fit(flights_with_elevations(seen))
    texts = [str(each.message) for each in caught]
    assert any("elevations are from" in text and said in text for text in texts) == bool(said)


@pytest.mark.parametrize(("unit", "size"), [("deg", np.pi / 180.0), ("mrad", 1e-3)])
def test_elevations_of_a_table_have_the_unit_of_their_values(unit, size):
    usual = Tracker({"state": "space"}).fit(flights_with_elevations(lambda elevation: elevation))
    columns = flights_with_elevations(lambda elevation: elevation / size)
    found = Tracker({"state": "space"}).fit(columns)
    assert found.parameters["radar.units.elevation"] == unit
    for name in ("radar.elevation_std_deg", "radar.fov_elevation_deg"):
        assert found.parameters[name] == usual.parameters[name]
    assert found.parameters["radar.elevation_std_deg"] == pytest.approx(0.97, abs=0.1)
    # One that is given stays.
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        Tracker({"state": "space", "radar.units.elevation": "rad"}).fit(columns)
    assert any("elevations beyond the zenith" in str(each.message) for each in caught)


def test_detections_whose_package_is_not_installed_are_named(monkeypatch):
    monkeypatch.setattr(recorded_plots.interfaces, "installed_class", lambda _: None)
    bag = SimpleNamespace(path="bag", types={"/objects": "vision_msgs/msg/Detection3DArray"})
    with pytest.raises(BagError, match="bag: /objects needs vision_msgs, which is not installed"):
        recorded_plots.recognised_radars(bag)


def test_nothing_set_finds_drones_and_their_heights(tmp_path, capsys):
    bare = shutil.copytree(DRONES, tmp_path / "bare")
    (bare / "parameters.yaml").unlink()
    out = tmp_path / "proposed.yaml"
    assert tune(bare, "--out", out) == 0
    found = from_arguments.load(out)
    assert found["state"] == "space"
    assert found["dome.elevation_std_deg"] == pytest.approx(1.2, rel=0.15)
    assert found["dome.range_std"] == pytest.approx(1.5, rel=0.15)
    low, high = found["dome.fov_elevation_deg"]
    assert -4.0 < low < -1.5
    assert 59.5 < high < 62.0
    capsys.readouterr()


def test_tune_proposes_the_biases_that_reports_show(tmp_path, capsys):
    out = tmp_path / "proposed.yaml"
    assert tune("approach_adsb", "--seconds", "150", "--out", out) == 0
    values = from_arguments.config_of(from_arguments.load(out)).values
    far, gain, clockwise_deg, late_s = values["west.biases"]
    assert far + 40e3 * gain == pytest.approx(60.0, abs=20.0)
    assert clockwise_deg == pytest.approx(-0.15, abs=0.015)
    assert late_s == pytest.approx(0.0, abs=0.06)
    (line,) = [line for line in out.read_text().splitlines() if "biases:" in line]
    assert "# +-[" in line
    assert "16 common tracks" in line
    assert "biases" in capsys.readouterr().out


def test_tune_says_why_reports_show_no_biases(tmp_path, capsys):
    given = from_arguments.load(BAGS / "approach_adsb" / "parameters.yaml")
    elsewhere = tmp_path / "elsewhere.yaml"
    given = {**given, "world_origin": [50.0, 18.5, 0.0]}
    elsewhere.write_text(yaml.safe_dump({"/**/tracker": {"ros__parameters": given}}))
    assert tune("approach_adsb", "--seconds", "100", "--params-file", elsewhere) == 0
    said = capsys.readouterr()
    assert "tune: no biases from reports: " in said.err
    assert "range_std" in said.out


def test_tune_takes_sectors_without_parameters(tmp_path, capsys):
    bag, out = tmp_path / "bag", tmp_path / "proposed.yaml"
    shutil.copytree(BAGS / "harbour_ais", bag)
    (bag / "parameters.yaml").unlink()
    assert tune(bag, "--seconds", "100", "--out", out) == 0
    config = from_arguments.config_of(from_arguments.load(out))
    assert config.values["mast.rotation_s"] == pytest.approx(2.4, rel=1e-3)
    assert config.values["mast.range_std"] == pytest.approx(12.0, rel=0.2)
