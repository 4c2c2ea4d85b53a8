import json
from pathlib import Path

import numpy as np
import pytest

from msg_adapters.encoding import names
from phd_jdtc_ros import resources
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.report import load
from phd_jdtc_ros.tools import track_bag
from studies.command import main

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "bags" / "autoferry_2"
ODOMETRY = "/own_ship/odometry"


@pytest.fixture
def dataset(tmp_path):
    """Return a directory with a scenario of ten scans, in the dataset's form."""
    rows = ["scan,sensor,time,own_north,own_east,north,east"]
    truth = ["scan,sensor,time,target,north,east,down"]
    for scan in range(20):
        sensor, time_s, own = "lidar" if scan % 2 else "radar", 1000.0 + 0.8 * scan, 0.3 * scan
        rows.append(f"{scan},{sensor},{time_s:.3f},{own:.2f},5.0,{40.0 - own:.2f},{30.0 + scan}")
        truth.append(f"{scan},{sensor},{time_s:.3f},1,40.0,{35.0 + scan},0.0")
    (tmp_path / "scenario9_detections.csv").write_text("\n".join(rows))
    (tmp_path / "scenario9_truth.csv").write_text("\n".join(truth))
    return tmp_path


def test_autoferry_writes_a_bag_that_is_tracked(dataset, tmp_path):
    assert main(["autoferry_bags", str(dataset), "--out", str(tmp_path / "bags")]) == 0
    bag = tmp_path / "bags" / "autoferry_9"
    counts = BagReader(bag).counts
    assert counts == {"/radar/detections": 10, ODOMETRY: 20, names.TRUTH: 10}
    config = resolve(bag_parameters.read(bag))
    track_bag.track_bag(BagReader(bag), config, tmp_path / "out")
    last = load.record(tmp_path / "out", config)
    np.testing.assert_allclose(last.plots[-1].position, [[53.0, 40.0]], atol=0.1)
    assert np.hypot(*(last.filtered[-1].position - [53.0, 40.0]).T).min() < 5.0


def test_autoferry_writes_the_lidar_too_where_asked(dataset, tmp_path):
    given = [str(dataset), "--scenario", "9", "--lidar", "--out", str(tmp_path / "bags")]
    assert main(["autoferry_bags", *given]) == 0
    bag = tmp_path / "bags" / "autoferry_9_lidar"
    assert BagReader(bag).counts["/lidar/detections"] == 10
    config = resolve(bag_parameters.read(bag))
    tracker = track_bag.track_bag(BagReader(bag), config, tmp_path / "out")
    assert tracker.scans == 20
    assert not tracker.tally.dropped


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["autoferry_bags", "nowhere", "--out", "bags"], "no scenarioNUMBER_detections.csv in it"),
        (["autoferry", "--scenario", "4"], "directory: must be the directory of the dataset's CSV"),
        (["autoferry", "DATASET", "--scenario", "4"], "scenario4_detections.csv: cannot be"),
    ],
)
def test_autoferry_reports_what_is_missing(dataset, capsys, arguments, expected):
    given = [str(dataset) if argument == "DATASET" else argument for argument in arguments]
    assert main(given) == 2
    assert expected in capsys.readouterr().err


def test_the_shipped_recording_has_the_profiles_parameters():
    path, shown = resources.profile("autoferry")
    assert resources.bag(shown).resolve() == SHIPPED
    beside = resolve(bag_parameters.read(SHIPPED)).values
    assert beside == resolve(from_arguments.load(path)).values


def test_figures_of_the_shipped_recording_need_no_dataset(tmp_path, capsys):
    pytest.importorskip("stonesoup")
    few = ["-p", "particles_per_target:=200", "-p", "particles_per_birth:=256"]
    assert main(["autoferry", "--out", str(tmp_path), *few]) == 0
    found = json.loads((tmp_path / "autoferry.json").read_text())
    by_key = {(each["tracker"], each["source"]): each for each in found["scores"]}
    assert len(by_key) == 8
    assert by_key["gaussian", "filtered"]["gospa"] < 22.0
    assert by_key["gaussian", "smoothed"]["identity_switches"] == 0
    assert {goal["goal"] for goal in found["goals"]} == {0.85, 0.8}
    assert "GNN, smoothed" in capsys.readouterr().out


def test_the_shipped_recording_is_tracked_through_its_crossing(tmp_path):
    config = resolve(bag_parameters.read(SHIPPED))
    tracker = track_bag.track_bag(BagReader(SHIPPED), config, tmp_path / "out")
    assert tracker.scans == BagReader(SHIPPED).counts["/radar/detections"]
    assert not tracker.tally.dropped
    summary = load.record(tmp_path / "out", config).evaluate(50.0, 2.0).summary()
    assert summary["filtered"]["all"]["missed"] < 0.4
    assert summary["smoothed"]["all"]["missed"] < 0.3
