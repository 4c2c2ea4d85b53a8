"""A scenario of two radars on the round earth: simulated, tracked offline, written as files."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod

from msg_adapters.encoding import interfaces, names
from msg_adapters.targets import truth
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, yaml_files
from phd_jdtc_ros.report import load
from phd_jdtc_ros.tools import simulate, track_bag

ROOT = Path(__file__).parents[2]
SCENARIO = ROOT / "config" / "scenarios" / "two_approach_radars.yaml"
SCANS = 61
FLAT = str(ROOT / "bags" / "one_radar")


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """Return a directory with the first minute of the scenario, its tracks and their files."""
    directory = tmp_path_factory.mktemp("earth")
    document = yaml_files.load(SCENARIO)
    document["scans"] = SCANS
    # Six aircraft are enough here.
    document["targets"] = document["targets"][:6]
    path = directory / "scenario.yaml"
    path.write_text(json.dumps(document))
    bag, out = str(directory / "bag"), str(directory / "tracks")
    assert simulate.main(["--scenario", str(path), "--out", bag, "--seed", "5"]) == 0
    files = ["--geojson", str(directory / "t.geojson"), "--csv", str(directory / "t.csv")]
    assert track_bag.main([bag, "--out", out, *files]) == 0
    return directory, document


def test_tracks_by_latitude_and_longitude_are_at_the_aircraft(tracked):
    directory, document = tracked
    plane = SystemPlane(document["world_origin"])
    bag = BagReader(directory / "bag")
    true = {}
    for entry in bag.messages([names.TRUTH]):
        found = truth.from_msg(interfaces.decode(entry.data, names.CLOUD))
        true[found.stamp_ns / 1e9] = plane.to_geodetic(*found.position.T)
    with (directory / "t.csv").open() as file:
        rows = list(csv.DictReader(file))
    late = [row for row in rows if float(row["time"]) > 1030.0 and row["state"] == "confirmed"]
    assert len(late) >= 6 * 6
    apart = []
    for row in late:
        north, east = true[float(row["time"])]
        count = len(north)
        here = np.full(count, float(row["longitude"])), np.full(count, float(row["latitude"]))
        apart.append(Geod(ellps="WGS84").inv(*here, east, north)[2].min())
    assert np.median(apart) < 60.0
    assert max(apart) < 300.0


def test_geojson_has_the_tracks_of_the_csv_file(tracked):
    directory, _ = tracked
    document = json.loads((directory / "t.geojson").read_text())
    with (directory / "t.csv").open() as file:
        rows = list(csv.DictReader(file))
    by_number = {f["properties"]["number"]: f for f in document["features"]}
    assert sorted(by_number) == sorted({int(row["number"]) for row in rows})
    assert len(by_number) >= 6
    for number, track in by_number.items():
        times = [float(row["time"]) for row in rows if int(row["number"]) == number]
        assert track["properties"]["times"] == pytest.approx(times)


def test_geojson_needs_an_origin(tmp_path, capsys):
    out = ["--out", str(tmp_path / "out"), "--geojson", str(tmp_path / "t.json")]
    assert track_bag.main([FLAT, *out]) == 2
    assert "--geojson: given without world_origin" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_csv_without_an_origin_has_x_and_y(tmp_path):
    out = tmp_path / "out"
    # It may be in the directory that the bag makes.
    assert track_bag.main([FLAT, "--out", str(out), "--csv", str(out / "t.csv")]) == 0
    with (out / "t.csv").open() as file:
        rows = list(csv.DictReader(file))
    run = load.record(out, from_arguments.config_of(bag_parameters.read(out))).smoothed
    assert len(rows) == sum(np.count_nonzero(found.track_id) for found in run) > 50
    found = next(found for found in run if len(found))
    first = found.track_id.argmin()
    assert [float(rows[0][name]) for name in ("x", "y", "vx", "vy")] == pytest.approx(
        [*found.position[first], *found.velocity[first]], abs=0.006
    )
    assert {(row["latitude"], row["longitude"], row["course"]) for row in rows} == {("", "", "")}


WRONG_FILES = {
    "one path": (["--csv", "t", "--geojson", "x/../t"], "--csv: t given, --geojson has it too"),
    "no folder": (["--csv", "nowhere/t.csv"], "nowhere is no directory"),
    "existing": (["--csv", "there"], "there already exists, a file is not overwritten"),
    "the bag": (["--csv", "out"], "out given, --out has it too"),
    "folder": (["--csv", "x"], "x given, must be a file, is a directory"),
}


@pytest.mark.parametrize("case", WRONG_FILES)
def test_files_that_cannot_be_written_are_refused_first(tmp_path, monkeypatch, capsys, case):
    monkeypatch.chdir(tmp_path)
    Path("there").write_text("kept")
    Path("x").mkdir()
    arguments, expected = WRONG_FILES[case]
    origin = ["-p", "world_origin:=[52.0, 5.0, 0.0]"]
    assert track_bag.main([FLAT, "--out", "out", *arguments, *origin]) == 2
    assert expected in capsys.readouterr().err
    assert not Path("out").exists()
    assert Path("there").read_text() == "kept"


def test_a_radar_on_the_earth_that_does_not_turn_is_not_simulated(tmp_path, capsys):
    document = yaml_files.load(SCENARIO)
    document["parameters"]["east"]["rotation_s"] = 0.0
    path = tmp_path / "scenario.yaml"
    path.write_text(json.dumps(document))
    assert simulate.main(["--scenario", str(path), "--out", str(tmp_path / "bag")]) == 2
    assert "east.rotation_s: 0 given, must be above 0" in capsys.readouterr().err
