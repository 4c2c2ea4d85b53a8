"""The study of self-reports in a short form."""

import json

from studies.command import main
from studies.reports.harbours import LIES, TURN_S, Scores, addresses


def test_reports_help_the_radar_and_tell_who_is_dark_and_who_lies(tmp_path, capsys):
    given = ["--runs", "1", "--seed", "3", "--minutes", "4", "--out", str(tmp_path)]
    assert main(["self_reports", *given]) == 0
    assert "relative to the radar alone" in capsys.readouterr().out
    found = json.loads((tmp_path / "self_reports.json").read_text())
    assert found["rms"]["joint"] < 0.8 * found["rms"]["radar"]
    assert found["rms"]["radar"] < 40.0
    assert found["calls"]["called"] == found["calls"]["of"] == 3
    assert found["calls"]["median_s"] > 20.0
    trackers = found["trackers"]
    assert trackers["both"]["rms"] < 0.8 * trackers["plot Kalman"]["rms"]
    assert trackers["plot Kalman"]["rms"] < 40.0
    assert trackers["AIS alone"]["found"] < trackers["radar alone"]["found"]
    assert (tmp_path / "reports_reliability.png").read_bytes().startswith(b"\x89PNG")
    # Of odd seeds the lie goes with the true velocity.
    fits, true = found["liar"].values()
    assert (fits["of"], true["of"], true["called"]) == (0, 1, 1)
    since_report = found["liar_heard"]["true velocity"]["largest_s"]
    assert 0.0 <= since_report < true["largest_s"]
    assert found["owned"] > 500
    assert found["wrong"] < 0.01 * found["owned"]
    assert found["calibration"]["owned"]["right"][-1] > 0.99
    silent = found["calibration"]["silent"]
    assert silent["right"][-1] > 0.9 > 0.1 > silent["right"][0]
    dark = found["calibration"]["dark"]
    assert dark["right"][-1] > 0.9 > 0.1 > dark["right"][0]
    shares = [n * share for n, share in zip(dark["number"], dark["right"], strict=True) if n]
    # Three ships, in the 75 revolutions after the first minute.
    assert 200 < sum(shares) <= 3 * 75


def test_an_owner_is_wrong_if_its_track_follows_another_ship():
    scores, (first, second, *_) = Scores(None, LIES[0], []), addresses()
    for turn in range(20):
        # For one revolution the plots of the first ship are nearer to the second one.
        scores._followed.append((turn * TURN_S, 7, int(turn == 3), first, 1.0))
        # The other track has the first ship's source for one revolution, and once perhaps.
        wrong, said = (turn in (5, 9), 0.6 if turn == 9 else 1.0)
        scores._followed.append((turn * TURN_S, 8, 1, first if wrong else second, said))
        scores._followed.append((turn * TURN_S, 9, 2, 0, 0.0))
    scores.add_owners()
    assert (scores.figures["owned"], scores.figures["wrong"]) == (39, 1)
    assert len(scores.figures["owned_said"]) == 40
    assert sum(scores.figures["owned_true"]) == 38
