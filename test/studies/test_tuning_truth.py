import json
import shutil
from pathlib import Path

from studies.command import main

BAG = Path(__file__).parents[2] / "bags" / "one_radar"


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
