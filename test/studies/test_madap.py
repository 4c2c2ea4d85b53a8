"""The MADAP benchmark: its scenario, its figures, its command."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.parameter_files import yaml_files
from phd_jdtc_ros.parameter_files.from_arguments import scenario_parameters
from phd_jdtc_ros.simulation import scenario_file
from studies.command import main
from studies.madap import FIGURES, SETTLING_S, errors_of, figures_of, goals_of

ROOT = Path(__file__).parents[2]
NM, KT = 1852.0, 1852.0 / 3600.0


@pytest.fixture(scope="module")
def benchmark():
    document = yaml_files.load(ROOT / "config" / "scenarios" / "madap.yaml")
    config = resolve(scenario_parameters(document))
    return config, scenario_file.resolve(document, config.model.radars)


def test_the_radars_are_at_their_latitudes_and_longitudes(benchmark):
    radars = {radar.name: np.array(radar.position) for radar in benchmark[0].model.radars}
    assert len(radars) == 8
    # Great circles on the sphere, computed by the haversine formula.
    for a, b, km in (("dhel", "leer", 123.4), ("boos", "pfal", 542.4), ("lued", "bert", 215.0)):
        assert np.hypot(*(radars[a] - radars[b])) / 1e3 == pytest.approx(km, rel=2e-3)


def test_the_flights_turn_by_their_bank_angles(benchmark):
    _, found = benchmark
    rates = [abs(math.degrees(flight.legs[1].turn_rate)) for flight in found.flights]
    assert len(rates) == 16
    assert rates[3] == pytest.approx(7.88, abs=0.01)
    slow = math.degrees(9.80665 * math.tan(math.radians(15.0)) / 308.667)
    assert rates[12] == pytest.approx(slow, rel=1e-4)
    np.testing.assert_allclose([flight.end_s for flight in found.flights], 948 * 4.8)
    headings = [math.atan2(*flight.velocity) for flight in found.flights]
    np.testing.assert_allclose(headings, 0.0, atol=1e-12)


def update(seconds, *rows):
    """Return the truth at a time, rows of x, y, vx, vy, turn rate."""
    state = np.array(rows, dtype=float).reshape(-1, 5)[:, [0, 2, 1, 3, 4]]
    number = np.arange(1, len(state) + 1)
    return Truth(round(seconds * 1e9), state, number, np.zeros(len(state), dtype=int))


def tracks(*rows):
    table = np.array(rows, dtype=float).reshape(-1, 4)
    return PointSet(table[:, :2], np.zeros(len(table), dtype=int), None, table[:, 2:])


def test_errors_are_those_of_position_speed_and_heading():
    north, east = (0.0, 0.0, 0.0, 100 * KT, 0.0), (50 * NM, 0.0, 200 * KT, 0.0, 0.1)
    truth = [update(0.0, north, east), update(SETTLING_S + 1.0, north, east)]
    found = [tracks(), tracks((50 * NM, 3.0 * NM, 0.0, 190 * KT), (0.5 * NM, 0.0, 0.0, 104 * KT))]
    errors = errors_of(truth, found)
    assert errors.expected == 2
    np.testing.assert_allclose(errors.position, [0.5, 3.0])
    np.testing.assert_allclose(errors.speed, [4.0, -10.0])
    # The second flies to the north and not to the east: 90 degrees to the left.
    np.testing.assert_allclose(errors.heading, [0.0, -90.0], atol=1e-9)
    assert errors.turning.tolist() == [False, True]


def test_a_track_far_from_every_flight_is_none_of_theirs():
    truth = [update(0.0), update(100.0, (0.0, 0.0, 10.0, 0.0, 0.0))]
    errors = errors_of(truth, [tracks(), tracks((6.0 * NM, 0.0, 10.0, 0.0))])
    assert (len(errors.position), errors.expected) == (0, 1)
    assert figures_of(errors)["position error, mean"] is None


def test_figures_separate_straights_and_turns():
    straight, turning = (0.0, 0.0, 100.0, 0.0, 0.0), (1e5, 0.0, 100.0, 0.0, 0.1)
    truth = [update(0.0)] + [update(100.0 + k, straight, turning) for k in range(4)]
    found = [tracks()] + [
        tracks((0.1 * k * NM, 0.0, 100.0, 0.0), (1e5 + 0.4 * k * NM, 0.0, 100.0, 0.0))
        for k in range(4)
    ]
    figures = figures_of(errors_of(truth, found))
    assert figures["position within 0.25 NM, straight"] == pytest.approx(0.75)
    assert figures["position within 1 NM, turns"] == pytest.approx(0.75)
    assert figures["position error, mean"] == pytest.approx((0.6 + 2.4) / 8.0)
    assert figures["flights with a track"] == 1.0
    assert figures["heading within 10 deg, straight"] == 1.0


def test_goals_are_the_published_results():
    better = {figure.name: figure.multi_radar for figure in FIGURES}
    worse = {**better, "position error, mean": 0.07, "position within 0.25 NM, straight": 0.9}
    goals = goals_of({"filtered": worse, "smoothed": better})
    reached = {goal["name"]: goal["reached"] for goal in goals}
    assert len(goals) == 10
    assert reached["position error, mean, filtered"] is False
    assert reached["position within 0.25 NM, straight, filtered"] is False
    assert sum(reached.values()) == 8
    nothing = dict.fromkeys(better)
    assert {goal["reached"] for goal in goals_of({"filtered": nothing})} == {None}


def test_the_command_prints_our_figures_beside_the_published_ones(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    arguments = ["--minutes", "2", "--out", str(tmp_path), "--seed", "2"]
    arguments += ["-p", "particles_per_target:=100", "-p", "particles_per_birth:=256"]
    assert main(["madap", *arguments]) == 0
    text = capsys.readouterr().out
    assert "published" in text
    assert "0.060 NM" in text
    summary = json.loads((tmp_path / "madap.json").read_text())
    assert list(summary["figures"]) == ["filtered", "smoothed", "plot Kalman"]
    assert summary["figures"]["plot Kalman"]["position error, mean"] < 0.2
    assert len(summary["goals"]) == 10
