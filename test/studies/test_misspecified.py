import json
from dataclasses import replace

from studies import misspecified
from studies.command import main


def test_learning_is_compared_with_true_and_nominal_values(tmp_path, capsys, monkeypatch):
    two = {name: misspecified.CASES[name] for name in ("all right", "noise x 2")}
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
    right, noise = found["cases"]["all right"], found["cases"]["noise x 2"]
    assert right["told"] == right["wrong"]
    assert noise["told"]["filtered"] < noise["learned"]["filtered"] < noise["wrong"]["filtered"]
    rates = found["rates"][of_rates]
    assert 0.0 < rates["learned"]["smoothed"] < rates["learned"]["filtered"] < 3.0
    joined = json.loads((tmp_path / "summary.json").read_text())
    assert joined["goals"] == found["goals"]
    assert joined["misspecified"]["cases"] == found["cases"]
