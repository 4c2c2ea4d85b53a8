"""Studies that run beside a Monte Carlo study."""

import json
import sys

import pytest

from phd_jdtc_ros.exit_status import FAILED, OK
from phd_jdtc_ros.tools.beside import Beside


def test_studies_run_meanwhile_and_are_shown_at_the_end(tmp_path, capfd):
    with Beside([("madap", "--help"), ("seam", "--seed", "-1")], tmp_path) as others:
        assert others.busy() == 1
    assert others.busy() == 0
    assert "MADAP" not in capfd.readouterr().out
    # The second one has no such seed.
    assert others.finish() == FAILED
    assert "usage: madap" in capfd.readouterr().out


@pytest.mark.parametrize("name", ["registration", "hours"])
def test_goals_of_other_studies_are_among_those_of_the_summary(tmp_path, name):
    summary = tmp_path / "summary.json"
    summary.write_text(json.dumps({"goals": [{"name": "filter"}]}))
    found = {"goals": [{"name": "range bias", "reached": True}]}
    (tmp_path / f"{name}.json").write_text(json.dumps(found))
    # Its help succeeds at once.
    with Beside([(name, "--help")], tmp_path) as others:
        pass
    assert others.finish() == OK
    goals = json.loads(summary.read_text())["goals"]
    assert [goal["name"] for goal in goals] == ["filter", "range bias"]


def test_studies_end_with_what_they_are_beside(tmp_path):
    with pytest.raises(KeyboardInterrupt), Beside([("madap",), ("seam",)], tmp_path) as others:
        raise KeyboardInterrupt
    assert others.busy() == 0
    assert not (tmp_path / "madap.json").exists()


def test_a_study_that_cannot_begin_has_failed(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no_python"))
    with Beside([("madap", "--help"), ("seam", "--help")], tmp_path) as others:
        pass
    assert others.finish() == FAILED
    assert "seam: not started" in capfd.readouterr().out


def test_no_study_takes_no_time(tmp_path):
    with Beside([], tmp_path) as others:
        pass
    assert others.finish() == OK
