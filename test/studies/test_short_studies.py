"""Studies in short forms: their tables, files and exit statuses."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.simulation.scenario import truth_after
from studies import handover, hard_traffic, misspecified
from studies.command import main
from studies.handover import CORE, JOINT, ONE, scene

BAG = Path(__file__).parents[2] / "bags" / "one_radar"


def test_learning_is_compared_with_true_and_nominal_values(tmp_path, capsys, monkeypatch):
    two = {name: misspecified.CASES[name] for name in ("nominal", "noise x 2")}
    monkeypatch.setattr(misspecified, "CASES", two)
    usual = misspecified.simulated_run

    def shorter_run(scenario, seed):
        return usual(replace(scenario, scans=min(scenario.scans, 80)), seed)

    monkeypatch.setattr(misspecified, "simulated_run", shorter_run)
    of_rates = "range rates, noise x 2"
    monkeypatch.setattr(misspecified, "RATE_CASES", {of_rates: 2.0})
    arguments = ["--engine", "gaussian", "--runs", "1", "--seed", "3", "--out", str(tmp_path)]
    assert main(["misspecified", *arguments]) == 0
    assert "nominal values" in capsys.readouterr().out
    found = json.loads((tmp_path / "misspecified.json").read_text())
    right, noise = found["cases"]["nominal"], found["cases"]["noise x 2"]
    assert right["true values"] == right["nominal values"]
    true, nominal, learned = (each["filtered"] for each in noise.values())
    assert true < learned < nominal
    rates = found["rates"][of_rates]
    assert 0.0 < rates["learned"]["smoothed"] < rates["learned"]["filtered"] < 3.0
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
    scenario = scene(resolve({}), 0)
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
