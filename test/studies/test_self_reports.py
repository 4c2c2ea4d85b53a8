"""The study of self-reports in a short form."""

import json

from studies.command import main


def test_reports_help_the_radar_and_tell_who_is_dark_and_who_lies(tmp_path, capsys):
    given = ["--runs", "1", "--seed", "3", "--minutes", "4", "--out", str(tmp_path)]
    assert main(["self_reports", *given]) == 0
    assert "relative to the radar alone" in capsys.readouterr().out
    found = json.loads((tmp_path / "self_reports.json").read_text())
    assert found["rms"]["joint"] < 0.8 * found["rms"]["radar"]
    assert found["rms"]["radar"] < 40.0
    assert found["dark"]["called"] == found["dark"]["of"] == 3
    assert found["dark"]["median_s"] > 20.0
    # Of odd seeds the lie goes with the true velocity.
    fits, true = found["liar"].values()
    assert (fits["of"], true["of"], true["called"]) == (0, 1, 1)
    assert found["owned"] > 500
    assert found["wrong"] < 0.01 * found["owned"]
    rows = found["calibration"]
    assert rows[-1]["true"] > 0.9 > 0.1 > rows[0]["true"]
    shares = [row["count"] * row["true"] for row in rows if row["count"]]
    # Three ships, in the 75 revolutions after the first minute.
    assert 200 < sum(shares) <= 3 * 75
