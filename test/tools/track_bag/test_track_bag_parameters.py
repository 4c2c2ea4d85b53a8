"""The parameters beside a bag."""

import shutil
from pathlib import Path

import pytest
from bag_content import first

from phd_jdtc_ros.parameter_files import bag_parameters

ROOT = Path(__file__).parents[3]
BAGS = ROOT / "bags"


@pytest.fixture(scope="module")
def one_radar(tmp_path_factory):
    """Return the first scans of the bag of one radar."""
    return first(8, BAGS / "one_radar", tmp_path_factory.mktemp("first") / "one_radar")


def test_track_bag_takes_parameters_beside_the_bag(one_radar, track, tmp_path, same_files, capsys):
    scenario = ROOT / "config" / "scenarios" / "one_radar.yaml"
    _, alone = track(one_radar, out="a/one")
    _, told = track(one_radar, "--scenario", scenario, out="b/one")
    assert same_files(alone, told)
    assert "recorded" not in capsys.readouterr().err
    # Its output is tracked and reported by one argument too.
    assert bag_parameters.read(alone)["births"] == ["north_west", "south_west"]


def test_track_bag_changes_single_parameters_of_those_beside_the_bag(one_radar, track):
    _, out = track(one_radar, "-p", "lag:=2")
    found = bag_parameters.read(out)
    assert (found["sensors"], found["lag"]) == (["radar_1"], "2")


FILE = "/**/tracker: {ros__parameters: {sensors: [radar_1]}}\n"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (
            ("--params-file", "mine.yaml"),
            [
                "radar_1.position: [0.0, 0.0] recorded, [1000.0, 0.0] given",
                "births: [north_west, south_west] recorded, "
                "[start_1, start_2, start_3, start_4] given",
            ],
        ),
        (("-p", "radar_1.clutter_rate:=5"), ["radar_1.clutter_rate: 20.0 recorded, 5.0 given"]),
    ],
    ids=["file", "assignment"],
)
def test_track_bag_reports_where_the_given_scene_is_not_the_recorded_one(
    one_radar, track, tmp_path, monkeypatch, capsys, given, expected
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(FILE)
    status, _ = track(one_radar, *given)
    said = [line for line in capsys.readouterr().err.splitlines() if "recorded" in line]
    assert status == 0
    assert said == [f"{one_radar / 'parameters.yaml'}: {line}" for line in expected]


def test_track_bag_refuses_parameters_beside_the_bag_that_are_none(track, short_bag, tmp_path):
    shutil.copytree(short_bag, tmp_path / "copy")
    (tmp_path / "copy" / "parameters.yaml").write_text("/**: {ros__parameters: {lak: 2}}\n")
    assert track(tmp_path / "copy")[0] == 2


@pytest.mark.parametrize("beside", [True, False])
def test_track_bag_reports_that_the_truth_has_more_classes(track, tmp_path, capsys, beside):
    bag = first(5, BAGS / "three_classes", tmp_path / "bag")
    if not beside:
        (bag / "parameters.yaml").unlink()
    assert track(bag)[0] == 0
    said = (
        "track_bag: the truth has class_id 2, and the tracker 2 classes" in capsys.readouterr().err
    )
    assert said is not beside
