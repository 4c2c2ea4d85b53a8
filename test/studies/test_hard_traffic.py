import json

import pytest

from studies import hard_traffic
from studies.command import main


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
