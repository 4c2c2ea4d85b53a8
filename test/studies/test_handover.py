import json

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.simulation.scenario import truth_after
from studies import handover
from studies.command import main
from studies.handover import CORE, JOINT, ONE, scene


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
