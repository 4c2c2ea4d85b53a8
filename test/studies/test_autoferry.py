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
from studies.autoferry import bags
from studies.autoferry import recording as autoferry
from studies.autoferry import scores as autoferry_scores
from studies.command import main

DETECTIONS = """\
scan,sensor,time,own_north,own_east,north,east
0,lidar,100.188,-16.75,-390.66,,
1,radar,100.534,-16.77,-391.13,-142.62,-218.25
1,radar,100.534,-16.77,-391.13,102.77,38.91
2,lidar,100.534,-16.77,-391.13,3.0,4.0
3,radar,102.213,-16.80,-391.50,,
"""
TRUTH = """\
scan,sensor,time,target,north,east,down
0,lidar,100.200,1,80.0,-350.0,0.00
0,lidar,100.200,2,-150.0,-580.0,0.00
1,radar,100.600,1,84.0,-354.0,0.00
1,radar,100.600,2,-150.4,-580.4,0.00
3,radar,102.200,1,100.0,-370.0,0.00
3,radar,102.200,2,-152.0,-582.0,0.00
"""
CHANGES = {"lidar.range_std": 9.0}
ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "bags" / "autoferry_2"
ODOMETRY = "/own_ship/odometry"


@pytest.fixture
def directory(tmp_path):
    (tmp_path / "scenario7_detections.csv").write_text(DETECTIONS)
    (tmp_path / "scenario7_truth.csv").write_text(TRUTH)
    return tmp_path


def test_scenarios_are_found_by_their_files(directory):
    assert autoferry.scenarios_in(directory) == [7]
    with pytest.raises(autoferry.RecordingError, match=r"no scenarioNUMBER_detections\.csv"):
        autoferry.scenarios_in(directory / "nowhere")


def test_detections_are_polar_about_the_ferry(directory):
    recording = autoferry.read(directory, 7)
    assert [look.sensor for look in recording.looks] == ["lidar", "radar", "lidar", "radar"]
    look = recording.of("radar")[0]
    assert look.stamp_ns == 100_534_000_000
    assert look.own.position == (-391.13, -16.77)
    distance, azimuth = look.detections.measurement[1]
    east, north = distance * np.cos(azimuth), distance * np.sin(azimuth)
    assert (east, north) == pytest.approx((38.91, 102.77))
    assert len(recording.of("radar")[1].detections) == 0


def test_sensors_of_one_stamp_are_one_scan(directory):
    recording = autoferry.read(directory, 7)
    scans = autoferry_scores.scans_of(recording, ("radar", "lidar"))
    assert [[found is not None for found in scan.detections] for scan in scans] == [
        [False, True],
        [True, True],
        [True, False],
    ]
    assert len(autoferry_scores.scans_of(recording)) == 2


def test_the_truth_is_interpolated_to_the_stamp(directory):
    truth = autoferry.read(directory, 7).truth(100_400_000_000)
    np.testing.assert_array_equal(truth.track_id, [1, 2])
    np.testing.assert_allclose(truth.position, [[-352.0, 82.0], [-580.2, -150.2]])
    np.testing.assert_allclose(truth.velocity[0], [-10.0, 10.0])
    assert len(autoferry.read(directory, 7).truth(110_000_000_000).track_id) == 0


@pytest.mark.parametrize(
    ("file", "old", "new", "expected"),
    [
        ("detections", "sensor,time", "kind,time", "column sensor is missing"),
        ("detections", "1,radar", "1,sonar", ":3: sensor 'sonar', must be radar or lidar"),
        ("detections", "38.91", "far", ":4: east 'far', must be a finite number"),
        ("detections", "38.91", "", ":4: east '', must be a finite number"),
        ("detections", "102.213", "90.0", ":6: time 90.0, must rise from scan to scan"),
        ("truth", "84.0", "nan", ":4: north 'nan', must be a finite number"),
    ],
)
def test_a_foreign_file_is_refused_with_the_line(directory, file, old, new, expected):
    path = directory / f"scenario7_{file}.csv"
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(autoferry.RecordingError) as why:
        autoferry.read(directory, 7)
    assert expected in str(why.value)


def score(tracker, source, gospa):
    return autoferry_scores.Score(2, tracker, source, gospa, 0.1, 0.2, 5.0)


def test_goals_compare_with_the_better_peer_of_the_same_source():
    values = {"gaussian": 33.0, "GNN": 40.0, "JPDA": 50.0}
    scores = [score(name, s, v) for name, v in values.items() for s in ("filtered", "smoothed")]
    goals = autoferry_scores.goals_of(scores)
    filtered, smoothed = goals
    assert filtered["name"] == "GOSPA filtered, gaussian, to the better peer's"
    assert filtered["value"] == smoothed["value"] == pytest.approx(33.0 / 40.0)
    assert (filtered["reached"], smoothed["reached"]) == (True, False)


@pytest.fixture(scope="module")
def boats(tmp_path_factory):
    """Two boats that go straight on, seen from a ferry that moves, and the scores of trackers."""
    pytest.importorskip("stonesoup")
    directory = tmp_path_factory.mktemp("boats")
    rng, rows, truth = np.random.default_rng(0), [], []
    for scan in range(34):
        time_s, own = 1000.0 + 1.68 * scan, np.array([0.5 * scan, -0.3 * scan])
        for target, (place, velocity) in enumerate(
            [((60.0, 80.0), (-2.0, 1.0)), ((-90.0, 50.0), (1.5, -2.0))], start=1
        ):
            north, east = np.array(place) + 1.68 * scan * np.array(velocity)
            truth.append(f"{scan},radar,{time_s:.3f},{target},{north},{east},0")
            seen = [north, east] - own + rng.normal(0.0, 2.0, 2)
            rows.append(f"{scan},radar,{time_s:.3f},{own[0]},{own[1]},{seen[0]},{seen[1]}")
    head, head_truth = DETECTIONS.splitlines()[0], TRUTH.splitlines()[0]
    (directory / "scenario1_detections.csv").write_text("\n".join([head, *rows]))
    (directory / "scenario1_truth.csv").write_text("\n".join([head_truth, *truth]))
    recording = autoferry.read(directory, 1)
    given = bags.parameters(lidar=False)
    return recording, autoferry_scores.scores_of(recording, given, None, CHANGES)


def test_trackers_are_scored_on_the_same_scans_with_changes_of_ours(boats):
    _, scores = boats
    assert {(each.tracker, each.source) for each in scores} == {
        (tracker, source)
        for tracker in ("gaussian", "GNN", "JPDA")
        for source in ("filtered", "smoothed")
    }
    assert all(each.false < 0.1 and each.missed < 0.7 for each in scores)
    assert all(each.position_rms < 6.0 for each in scores)
    recording, usual = boats
    changes = {**CHANGES, "radar.clutter_rate": 40.0}
    other = autoferry_scores.scores_of(recording, bags.parameters(lidar=False), None, changes)
    same = {mine.tracker for mine, changed in zip(usual, other, strict=True) if mine == changed}
    assert same == set(autoferry_scores.PEERS)


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
    assert main(["autoferry", "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "autoferry.json").read_text())
    by_key = {(each["tracker"], each["source"]): each for each in found["scores"]}
    assert len(by_key) == 6
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
