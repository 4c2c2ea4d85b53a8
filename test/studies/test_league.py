"""Trackers side by side on recordings that a manifest names."""

import json
from pathlib import Path

import numpy as np
import pytest

from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.parameter_files import from_arguments
from studies import command, league
from studies.league import Recorded, Tracked

ROOT = Path(__file__).parents[2]


def manifest(tmp_path, text):
    path = tmp_path / "league.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("recordings: {}", "must be a mapping of names to recordings"),
        ("recordings: {a: {}}", "must have either file or scenario"),
        ("recordings: {a: {file: x, scenario: 3}}", "must have either file or scenario"),
        ("recordings: {a: {file: x, cut: 3}}", "recordings.a.cut: unknown, must be one of cutoff"),
        ("recordings: {a: {file: x, cutoff: -1}}", "cutoff: -1 given, must be a distance"),
    ],
)
def test_manifests_are_refused_with_what_is_allowed(tmp_path, text, fault):
    with pytest.raises(ConfigError, match=fault):
        league.recordings_of(manifest(tmp_path, text))


@pytest.mark.parametrize("name", ["bags", "autoferry"])
def test_shipped_manifests_can_be_read(name):
    entries = league.recordings_of(ROOT / "config" / "leagues" / f"{name}.yaml")
    assert len(entries) > 5
    files = [entry["file"] for entry in entries.values() if "file" in entry]
    assert all((ROOT / "bags" / file).is_dir() for file in files)


def points(*places, labels=None):
    position = np.reshape(places, (-1, 2)).astype(float)
    label = None if labels is None else np.array(labels)
    return PointSet(position, np.zeros(len(position), dtype=np.int64), label)


def test_figures_are_those_of_an_enumerated_run():
    recorded = Recorded(from_arguments.config_of({}))
    recorded.truth = {k: points((0.0, 10.0 * k), (500.0, 0.0), labels=[1, 2]) for k in range(5)}
    # Target 1 is 3 m off, lost in scan 2, and comes back as another track; target 2 is never found.
    found = {k: points((3.0, 10.0 * k), labels=[7]) for k in (0, 1)}
    found |= {k: points((3.0, 10.0 * k), (300.0, 900.0), labels=[8, 9]) for k in (3, 4)}
    figures = league.score(recorded, Tracked(found, 1.5), 100.0)
    assert figures == {
        "found": 0.4,
        "rms": pytest.approx(3.0),
        "gaps": 1,
        "switches": 1,
        "false": 0.4,
        "cpu_s": 1.5,
        "scans": 5,
    }


def test_estimates_without_numbers_have_no_switches():
    recorded = Recorded(from_arguments.config_of({}))
    recorded.truth = {0: points((0.0, 0.0), labels=[1])}
    assert league.score(recorded, Tracked({0: points((1.0, 0.0))}, 0.0), 10.0)["switches"] is None


def test_a_shipped_bag_has_a_row_for_each_tracker(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(league.PEERS, league.SOUP, absent)
    given = ["league", str(ROOT / "bags"), "--manifest", "bags", "--only", "one_radar"]
    assert command.main([*given, "--out", str(tmp_path)]) == 0
    rows = json.loads((tmp_path / "league.json").read_text())["recordings"]["one_radar"]
    ours, kalman = rows[league.OURS], rows[league.KALMAN]
    assert ours["found"] > 0.95
    assert 0.8 < kalman["found"] <= 1.0
    assert ours["rms"] < kalman["rms"]
    assert ours["switches"] == 0
    assert "one_radar, Stone Soup GNN: the peers need Stone Soup" in capsys.readouterr().out


def absent(recorded):
    raise ImportError("the peers need Stone Soup")


def test_a_missing_recording_is_named(tmp_path, capsys):
    manifest(tmp_path, "recordings: {mine: {file: gone}}")
    assert command.main(["league", str(tmp_path), "--out", str(tmp_path)]) == 2
    assert "gone: no such recording" in capsys.readouterr().err


def test_reports_are_the_truth_where_they_are_withheld():
    # Two ships; at the second stamp one of them was silent for too long.
    config = from_arguments.config_of({"world_origin": [54.0, 10.0, 0.0]})
    cloud = {
        "latitude": np.array([54.0, 54.01, 54.0, 54.0]),
        "longitude": np.array([10.0, 10.0, 10.1, 10.1]),
        "time": np.array([0.0, 10.0, 0.0, 60.0]),
        "address": np.array([1, 1, 2, 2], dtype=np.uint32),
    }
    found = league.interpolated(cloud, config, [5 * 10**9])
    assert found[5 * 10**9].track_id.tolist() == [1]
    # A hundredth of a degree of latitude is 1113 m there.
    assert found[5 * 10**9].position == pytest.approx(np.array([[0.0, 556.5]]), abs=1.0)
