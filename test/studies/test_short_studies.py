"""Studies in short forms: their tables, files and exit statuses."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import biased
import numpy as np
import pytest
from rich.console import Console

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.sensors.bias import NO_BIAS
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.parameter_files import yaml_files
from phd_jdtc_ros.parameter_files.from_arguments import scenario_parameters
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import truth_after
from studies import conflicts, handover, hard_traffic, misspecified, registration
from studies.command import main
from studies.handover import CORE, JOINT, ONE, scene
from studies.madap import FIGURES, SETTLING_S, errors_of, expected_speed, figures_of, goals_of
from studies.registration import BIASED, CORRECTED, RUNS, UNBIASED, Row
from studies.runner import until

BAG = Path(__file__).parents[2] / "bags" / "one_radar"
# The tracker runs for so long.
TRACKED_S = 80.0
ROOT = Path(__file__).parents[2]
NM, KT = 1852.0, 1852.0 / 3600.0


def test_learning_is_compared_with_true_and_nominal_values(tmp_path, capsys, monkeypatch):
    two = {name: misspecified.CASES[name] for name in ("nominal", "noise x 2")}
    monkeypatch.setattr(misspecified, "CASES", two)
    usual = misspecified.simulated_run

    def shorter_run(scenario, seed):
        return usual(replace(scenario, scans=min(scenario.scans, 80)), seed)

    monkeypatch.setattr(misspecified, "simulated_run", shorter_run)
    monkeypatch.setattr(
        misspecified, "PROFILES", {"automotive": misspecified.PROFILES["automotive"]}
    )
    arguments = ["--runs", "1", "--seed", "3", "--out", str(tmp_path)]
    assert main(["misspecified", *arguments]) == 0
    assert "nominal values" in capsys.readouterr().out
    found = json.loads((tmp_path / "misspecified.json").read_text())
    right, noise = found["cases"]["nominal"], found["cases"]["noise x 2"]
    assert right["true values"] == right["nominal values"]
    true, nominal, learned = (each["filtered"] for each in noise.values())
    assert true < learned < nominal
    wrong = found["profiles"]["automotive, all wrong"]
    assert 0.0 < wrong["true values"]["smoothed"] < wrong["as shipped"]["filtered"] < 3.0
    joined = json.loads((tmp_path / "summary.json").read_text())
    assert joined["goals"] == found["goals"]
    assert joined["misspecified"]["cases"] == found["cases"]


@pytest.mark.parametrize(
    ("scene", "aircraft", "lost"), [("turns of 3 g", 6, 1), ("azimuths of 3 degrees", 12, 2)]
)
def test_aircraft_that_are_hard_to_follow_keep_their_tracks(
    scene, aircraft, lost, tmp_path, capsys, monkeypatch
):
    few = {scene: hard_traffic.SCENES[scene]._replace(aircraft=aircraft)}
    monkeypatch.setattr(hard_traffic, "SCENES", few)
    monkeypatch.setattr(hard_traffic, "DURATION_S", 160.0)
    assert main(["hard_traffic", "--runs", "1", "--seed", "5", "--out", str(tmp_path)]) == 0
    assert scene in capsys.readouterr().out
    found = json.loads((tmp_path / "hard_traffic.json").read_text())["scenes"][scene]
    filtered, smoothed, peer = found["filtered"], found["smoothed"], found["plot Kalman"]
    assert filtered["lost"] <= lost
    assert filtered["switches"] <= 1
    assert min(filtered["found"], smoothed["found"]) > max(0.9, peer["found"] - 0.01)
    assert smoothed["rms"] < 0.9 * filtered["rms"]
    assert filtered["false_tracks"] <= 1


def test_changes_are_found_and_none_where_there_is_none(tmp_path, capsys):
    given = ["changed_radars", "--runs", "1", "--seed", "3", "--out", str(tmp_path)]
    assert main(given) == 0
    assert "false alarms" in capsys.readouterr().out
    cases = json.loads((tmp_path / "changed_radars.json").read_text())["cases"]
    assert cases["no change"] == [{}]
    for own in cases["detection x 0.5"]:
        assert 40 <= own["fewer_detections"] <= 60
    for own in cases["blind sector"]:
        assert 40 <= own["blind_azimuth_deg"] <= 65
    joined = json.loads((tmp_path / "summary.json").read_text())["goals"]
    assert "changed radars, no change, false alarms" in {each["name"] for each in joined}


def test_proposals_are_beside_what_was_simulated(tmp_path, capsys):
    given = ["one_radar", "--seconds", "300", "--out", str(tmp_path)]
    assert main(["tuning_truth", *given]) == 0
    said = capsys.readouterr().out
    assert "found / simulated" in said
    assert "/ 300" in said
    (row,) = json.loads((tmp_path / "tuning_truth.json").read_text())["radars"]
    assert row[:2] == ["one_radar", "radar_1"]


def test_parameters_and_a_bag_are_needed(tmp_path, capsys):
    unknown = tmp_path / "unknown"
    shutil.copytree(BAG, unknown, ignore=shutil.ignore_patterns("parameters.yaml"))
    assert main(["tuning_truth", str(unknown)]) == 2
    assert "parameters.yaml is missing" in capsys.readouterr().err
    assert main(["tuning_truth", str(tmp_path / "none")]) == 2
    assert "no such bag" in capsys.readouterr().err


@pytest.fixture
def few(monkeypatch):
    """Four aircraft, for a minute."""
    monkeypatch.setattr(handover, "CROSSING", 3)
    monkeypatch.setattr(handover, "ALONG", 1)
    monkeypatch.setattr(handover, "DURATION_S", 60.0)
    monkeypatch.setattr(handover, "SETTLING_S", 20.0)


def test_aircraft_cross_the_seam_in_both_directions():
    scenario = scene(resolve(scenario_parameters(None)), 0)
    begin, end = (truth_after(scenario, s).position[:, 0] > handover.SEAM for s in (0.0, 179.0))
    east, west = (~begin & end).sum(), (begin & ~end).sum()
    assert min(east, west) >= 10
    assert east + west >= handover.CROSSING
    along = truth_after(scenario, 90.0).position[handover.CROSSING :, 0]
    assert np.abs(along - handover.SEAM).max() <= 1e3


def test_handover_prints_what_is_lost(few, tmp_path, capsys):
    given = ["--seed", "5", "--runs", "1", "--out", str(tmp_path)]
    assert main(["handover", *given]) == 0
    printed = capsys.readouterr().out
    scores = json.loads((tmp_path / "handover.json").read_text())["scores"]
    assert "two, handed over" in printed
    assert scores[ONE]["missing"] == scores[ONE]["duplicated"] == 0.0
    # Every aircraft that crosses has another number, unless it is handed over.
    assert scores[CORE]["switches"] >= 3
    assert scores[JOINT]["switches"] == 0
    assert scores[JOINT]["duplicated"] == 0.0
    assert scores[JOINT]["gospa"] < 1.05 * scores[ONE]["gospa"]


@pytest.fixture(scope="module")
def found():
    document = biased.document()
    # Without a lag and most of the clutter the tracker needs a tenth of the time.
    document["parameters"] |= {"lag": 0}
    for name in ("west", "east", "south"):
        document["parameters"][name]["clutter_rate"] = 1.0
    return registration.run(document, 7, None, TRACKED_S)


def test_the_tracker_gains_by_what_is_found(found):
    errors = found["rms_m"]
    assert tuple(errors) == RUNS
    for source in ("filtered", "smoothed"):
        assert errors[BIASED][source] > 1.2 * errors[UNBIASED][source]
        assert errors[CORRECTED][source] < 1.1 * errors[UNBIASED][source]
    rows = {(row["radar"], row["error"]): row for row in found["errors"]}
    azimuth = rows["east", "azimuth, clockwise"]
    assert azimuth["true"] == pytest.approx(0.3)
    assert azimuth["found"] == pytest.approx(0.3, abs=0.05)
    assert rows["east", "time offset"]["true"] == 0.5
    assert rows["south", "range bias"]["true"] == 0.0


def test_the_tables_show_every_error_and_run(found):
    console = Console(record=True, width=120)
    for table in registration.tables(found):
        console.print(table)
    text = console.export_text()
    assert text.count("east") == text.count("south") == 4
    assert text.count("reference") == 1
    for name in RUNS:
        assert name in text


def test_goals_are_of_the_radar_that_is_worst():
    rows = [
        Row("one", "range bias", "m", 80.0, 85.0, 2.0),
        Row("two", "range bias", "m", 0.0, -9.0, 2.0),
        Row("one", "azimuth, clockwise", "deg", 0.3, 0.31, 0.01),
        Row("one", "time offset", "s", 0.5, 0.52, 0.01),
    ]
    errors = {
        UNBIASED: {"filtered": 50.0, "smoothed": 30.0},
        CORRECTED: {"filtered": 52.0, "smoothed": 33.0},
    }
    goals = {goal["name"]: goal for goal in registration.goals_of(rows, errors)}
    assert len(goals) == 5
    assert all(name.startswith("registration: ") for name in goals)
    of_range = goals["registration: range bias, m"]
    assert (of_range["value"], of_range["goal"], of_range["reached"]) == (9.0, 8.0, False)
    assert goals["registration: azimuth, clockwise, deg"]["reached"]
    assert goals["registration: time offset, s"]["goal"] == 0.05
    assert goals["registration: RMS filtered, to no errors"]["reached"]
    assert not goals["registration: RMS smoothed, to no errors"]["reached"]


def test_a_part_of_a_scenario_has_the_targets_until_then():
    _, scene = biased.scene(biased.document(scans=1201))
    part = until(scene, 60.0)
    assert part.duration_s == 60.0
    starts = [flight.start_s for flight in part.flights]
    assert max(starts) <= 60.0
    assert len(starts) < len(scene.flights)
    assert part.bias(1) == scene.bias(1) != NO_BIAS
    assert replace(scene, biases=()).bias(1) == NO_BIAS


@pytest.fixture(scope="module")
def benchmark():
    document = yaml_files.load(ROOT / "config" / "scenarios" / "madap.yaml")
    config = resolve(scenario_parameters(document))
    return config, scenario_file.resolve(document, config.model.radars)


def test_the_radars_are_at_their_latitudes_and_longitudes(benchmark):
    radars = {radar.name: np.array(radar.position) for radar in benchmark[0].model.radars}
    assert len(radars) == 8
    # Great circles on the sphere, computed by the haversine formula.
    for a, b, km in (("dhel", "leer", 123.4), ("boos", "pfal", 542.4), ("lued", "bert", 215.0)):
        assert np.hypot(*(radars[a] - radars[b])) / 1e3 == pytest.approx(km, rel=2e-3)


def test_the_flights_turn_by_their_bank_angles(benchmark):
    _, found = benchmark
    rates = [abs(math.degrees(flight.legs[1].turn_rate)) for flight in found.flights]
    assert len(rates) == 16
    assert rates[3] == pytest.approx(7.88, abs=0.01)
    slow = math.degrees(9.80665 * math.tan(math.radians(15.0)) / 308.667)
    assert rates[12] == pytest.approx(slow, rel=1e-4)
    np.testing.assert_allclose([flight.end_s for flight in found.flights], 948 * 4.8)
    headings = [math.atan2(*flight.velocity) for flight in found.flights]
    np.testing.assert_allclose(headings, 0.0, atol=1e-12)


def update(seconds, *rows):
    """Return the truth at a time, rows of x, y, vx, vy, turn rate."""
    state = np.array(rows, dtype=float).reshape(-1, 5)[:, [0, 2, 1, 3, 4]]
    number = np.arange(1, len(state) + 1)
    return Truth(round(seconds * 1e9), state, number, np.zeros(len(state), dtype=int))


def tracks(*rows):
    table = np.array(rows, dtype=float).reshape(-1, 4)
    return PointSet(table[:, :2], np.zeros(len(table), dtype=int), None, table[:, 2:])


def test_errors_are_those_of_position_speed_and_heading():
    north, east = (0.0, 0.0, 0.0, 100 * KT, 0.0), (50 * NM, 0.0, 200 * KT, 0.0, 0.1)
    truth = [update(0.0, north, east), update(SETTLING_S + 1.0, north, east)]
    found = [tracks(), tracks((50 * NM, 3.0 * NM, 0.0, 190 * KT), (0.5 * NM, 0.0, 0.0, 104 * KT))]
    errors = errors_of(truth, found)
    assert errors.expected == 2
    np.testing.assert_allclose(errors.position, [0.5, 3.0])
    np.testing.assert_allclose(errors.speed, [4.0, -10.0])
    # The second flies to the north and not to the east: 90 degrees to the left.
    np.testing.assert_allclose(errors.heading, [0.0, -90.0], atol=1e-9)
    assert errors.turning.tolist() == [False, True]


def test_a_track_far_from_every_flight_is_none_of_theirs():
    truth = [update(0.0), update(100.0, (0.0, 0.0, 10.0, 0.0, 0.0))]
    errors = errors_of(truth, [tracks(), tracks((6.0 * NM, 0.0, 10.0, 0.0))])
    assert (len(errors.position), errors.expected) == (0, 1)
    assert figures_of(errors)["position error, mean"] is None


def test_figures_separate_straights_and_turns():
    straight, turning = (0.0, 0.0, 100.0, 0.0, 0.0), (1e5, 0.0, 100.0, 0.0, 0.1)
    truth = [update(0.0)] + [update(100.0 + k, straight, turning) for k in range(4)]
    found = [tracks()] + [
        tracks((0.1 * k * NM, 0.0, 100.0, 0.0), (1e5 + 0.4 * k * NM, 0.0, 100.0, 0.0))
        for k in range(4)
    ]
    figures = figures_of(errors_of(truth, found))
    assert figures["position within 0.25 NM, straight"] == pytest.approx(0.75)
    assert figures["position within 1 NM, turns"] == pytest.approx(0.75)
    assert figures["position error, mean"] == pytest.approx((0.6 + 2.4) / 8.0)
    assert figures["flights with a track"] == 1.0
    assert figures["heading within 10 deg, straight"] == 1.0


def test_goals_are_the_published_results():
    better = {figure.name: figure.multi_radar for figure in FIGURES}
    worse = {**better, "position error, mean": 0.07, "position within 0.25 NM, straight": 0.9}
    goals = goals_of({"filtered": worse, "smoothed": better})
    reached = {goal["name"]: goal["reached"] for goal in goals}
    assert len(goals) == 10
    assert reached["position error, mean, filtered"] is False
    assert reached["position within 0.25 NM, straight, filtered"] is False
    assert sum(reached.values()) == 8
    nothing = dict.fromkeys(better)
    assert {goal["reached"] for goal in goals_of({"filtered": nothing})} == {None}


def test_the_command_prints_our_figures_beside_the_published_ones(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    arguments = ["--minutes", "2", "--out", str(tmp_path), "--seed", "2"]
    assert main(["madap", *arguments]) == 0
    text = capsys.readouterr().out
    assert "published" in text
    assert "0.060 NM" in text
    summary = json.loads((tmp_path / "madap.json").read_text())
    assert list(summary["figures"]) == ["filtered", "smoothed", "plot Kalman"]
    assert summary["figures"]["plot Kalman"]["position error, mean"] < 0.2
    assert len(summary["goals"]) == 10


def test_the_speed_is_the_mean_of_speeds_whose_courses_differ():
    rng = np.random.default_rng(5)
    # The courses of a target at 200 m/s differ by 15 degrees.
    course = rng.normal(0.3, np.radians(15.0), 20000)
    velocities = 200.0 * np.column_stack([np.cos(course), np.sin(course)])
    mean, covariance = velocities.mean(axis=0)[None], np.cov(velocities.T)[None]
    assert expected_speed(mean, None)[0] == np.hypot(*mean[0]) < 195.0
    assert expected_speed(mean, covariance)[0] == pytest.approx(200.0, abs=0.5)


def test_conflicts_and_alarms_of_a_single_run_are_scored(tmp_path, capsys, monkeypatch):
    few = {"aircraft": conflicts.AIRCRAFT._replace(targets=15, radius=30e3, duration_s=160.0)}
    monkeypatch.setattr(conflicts, "SCENES", few)
    out = ["--runs", "1", "--seed", "5", "--out", str(tmp_path)]
    assert main(["conflicts", "--scenes", "aircraft", *out]) == 0
    assert "share of alarms said with 0.7" in capsys.readouterr().out
    found = json.loads((tmp_path / "conflicts.json").read_text())["scenes"]["aircraft"]
    reports, alarms = found["reports"], found["alarm_"]
    assert len(reports) == len(alarms) == len(conflicts.BOUNDS) - 1
    assert sum(row["count"] for row in reports) > 20
    assert sum(row["count"] for row in alarms) > 5
    # The interval of one run is not known.
    assert {row["half_width"] for row in (*reports, *alarms)} == {None}
    assert reports[-1]["true"] > 0.8
