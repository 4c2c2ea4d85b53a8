import json

from studies.command import main


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
