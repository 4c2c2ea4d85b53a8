import json

from studies.command import main


def test_proposals_are_beside_what_was_simulated(tmp_path, capsys):
    given = ["one_radar", "--seconds", "300", "--out", str(tmp_path)]
    assert main(["tuning_truth", *given]) == 0
    said = capsys.readouterr().out
    assert "found / simulated" in said
    assert "/ 300" in said
    (row,) = json.loads((tmp_path / "tuning_truth.json").read_text())["radars"]
    assert row[:2] == ["one_radar", "radar_1"]


def test_truth_is_needed_to_compare_with(tmp_path, capsys):
    assert main(["tuning_truth", "autoferry_2", "--out", str(tmp_path / "no")]) == 2
    assert main(["tuning_truth", str(tmp_path)]) == 2
    assert "no such bag" in capsys.readouterr().err
