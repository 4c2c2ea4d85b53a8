"""The scenes that nothing was tuned on, and the tracker beside ours on them."""

import itertools
import json
import math

import numpy as np
import pytest

from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.simulation.scenario import truth_after
from studies.command import main
from studies.new_scenes import study
from studies.new_scenes.traffic import SCENES
from studies.peers import integrated


def scene_of(name, seed=4):
    return SCENES[name](np.random.default_rng([seed, *name.encode()]))


@pytest.mark.parametrize("name", SCENES)
def test_all_targets_of_a_scene_are_seen(name):
    scene = scene_of(name)
    reports = scene.detections(7)
    found = {int(source) for report in reports for source in report.source}
    assert found >= set(range(1, len(scene.scenario.targets) + 1))
    looks = integrated.looks_of(scene.scenario, reports)
    assert [look.time_s for look in looks] == sorted(look.time_s for look in looks)
    # A revolution is cut into looks that lose no plot and know where the antenna was.
    assert sum(len(look.measurement) for look in looks) == sum(
        len(report.detections) for report in reports
    )
    for look in looks:
        if look.part is not None and len(look.measurement):
            inside = np.mod(look.measurement[:, 1] - look.part.start, 2.0 * math.pi)
            assert (inside <= look.part.width + 1e-6).all()


def test_a_radar_that_is_off_reports_nothing_and_sees_nobody():
    scene = scene_of("sensor off and on")
    times = [scene.after(each.stamp_ns) for each in scene.detections(7) if each.radar == 1]
    assert times
    assert not any(90.0 <= time < 170.0 for time in times)
    truth = truth_after(scene.scenario, 120.0)
    off = scene.in_sight(truth, 120.0)
    on = scene.in_sight(truth, 180.0)
    assert off.sum() < on.sum()


def test_nothing_comes_from_a_blind_sector():
    scene = scene_of("hole")
    truth = truth_after(scene.scenario, 130.0)
    assert 0 < scene.in_sight(truth, 130.0).sum() < len(truth.state)
    azimuths = np.concatenate([each.detections.measurement[:, 1] for each in scene.detections(7)])
    # West of the radar, but for the noise of its edges.
    assert (np.abs(np.abs(azimuths) - math.pi) > math.radians(24.0)).all()


def test_marginals_are_those_of_all_associations_of_two_tracks():
    missed, other = np.array([0.4, 0.7]), np.array([1e-3])
    weight = np.array([[2e-3], [1e-3]])
    whole = [0.0, 0.0, 0.0]
    for which in itertools.product((None, 0), repeat=2):
        if which.count(0) < 2:
            chosen = which.index(0) if 0 in which else 2
            factors = [
                weight[row, 0] if each == 0 else missed[row] for row, each in enumerate(which)
            ]
            whole[chosen] += math.prod(factors) * (1.0 if 0 in which else other[0])
    total = sum(whole)
    none, each, free = integrated.marginals(missed, weight, other)
    # Belief propagation is exact for one detection.
    np.testing.assert_allclose(each[:, 0], np.array(whole[:2]) / total, rtol=1e-6)
    np.testing.assert_allclose(none, 1.0 - each[:, 0], rtol=1e-6)
    np.testing.assert_allclose(free, whole[2] / total, rtol=1e-6)


def test_the_peer_finds_aircraft_before_two_radars_and_smooths_them():
    scene = scene_of("asynchronous")
    reports = [each for each in scene.detections(7) if scene.after(each.stamp_ns) < 80.0]
    times = np.arange(20.0, 80.0, 4.0).tolist()
    sources = integrated.follow(scene.scenario, reports, study.settings_of(scene), times)
    errors = []
    for found in sources:
        squares = [np.zeros(0)]
        for time, points in zip(times, found, strict=True):
            truth = truth_after(scene.scenario, time)
            own = truth.position[scene.in_sight(truth, time)]
            target, estimate = assign(own, points.position, 500.0)
            assert len(target) >= len(own) - 2
            squares.append(((own[target] - points.position[estimate]) ** 2).sum(axis=1))
        errors.append(np.sqrt(np.concatenate(squares).mean()))
    filtered, smoothed = errors
    assert smoothed < 0.8 * filtered < 100.0


def test_the_study_compares_all_trackers_on_a_scene(tmp_path, capsys):
    arguments = ["--scenes", "stop and go", "--runs", "1", "--seed", "3", "--out", str(tmp_path)]
    assert main(["new_scenes", *arguments]) == 0
    assert study.PEER in capsys.readouterr().out
    found = json.loads((tmp_path / "new_scenes.json").read_text())
    trackers = found["scenes"]["stop and go"]
    assert [*trackers] == [study.TOLD, study.LEARNS, study.PEER]
    for sources in trackers.values():
        assert sources["smoothed"]["ospa"] < sources["filtered"]["ospa"]
        assert sources["filtered"]["missed"] < 5.0
        assert 0.5 < sources["filtered"]["nees"] < 2.0
    for each in found["goals"]:
        assert each["reached"] == (each["value"] <= each["goal"])


def test_targets_out_of_sight_are_neither_missed_nor_false():
    scene = scene_of("hole")
    time_s = 130.0
    truth = truth_after(scene.scenario, time_s)
    everybody = study.PointSet.of(truth)
    own = study.scores(scene, [(truth.stamp_ns, everybody)])
    assert own["missed"] == own["false"] == own["ospa"] == 0.0
    seen = np.flatnonzero(scene.in_sight(truth, time_s))
    visible = study.scores(scene, [(truth.stamp_ns, everybody.only(seen))])
    assert visible["missed"] == visible["false"] == visible["ospa"] == 0.0
    one_less = study.scores(scene, [(truth.stamp_ns, everybody.only(seen[1:]))])
    assert one_less["missed"] == pytest.approx(100.0 / len(seen))
