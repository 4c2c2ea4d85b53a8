import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import reference
from reference import resolve

from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.study.tracker import simulated_run
from studies import peers
from studies.peers import soup
from studies.peers.conversion import detection, measurement_model
from studies.peers.mixture_phd import nearest_turn
from studies.peers.problem import Problem
from studies.peers.settings import ANYWHERE, LOUD_THRESHOLD
from studies.peers.threshold import raised_threshold

pytest.importorskip("stonesoup")

SCANS = 12
LAG = 3
# Scans that a tracker may take to confirm what it sees.
SETTLED = 3
NEAR_M = 500.0
# The noise with which they are studied.
NOISE = reference.parameters({"cv.noise_density": 1.0})
MODEL = resolve({}).model
every_peer = pytest.mark.parametrize("contender", peers.PEERS.values(), ids=peers.PEERS)


def short_run(clutter_rate=1.0, yaws_deg=(0.0, 0.0), targets=slice(3), seed=1):
    radars = [
        replace(radar, clutter_rate=clutter_rate, yaw=math.radians(yaw))
        for radar, yaw in zip(MODEL.radars, yaws_deg, strict=True)
    ]
    scenario = paper_scenario(tuple(radars))
    return simulated_run(
        replace(scenario, scans=SCANS, targets=scenario.targets[targets]), seed=seed
    )


def missed(run, points):
    """Number of targets, over the settled scans, without an estimate near them."""
    total = 0
    for truth, found in list(zip(run.truth, points, strict=True))[SETTLED:]:
        near, _ = assign(truth.position, found.position, NEAR_M)
        total += len(truth.state) - len(near)
    return total


@pytest.fixture(scope="module")
def run():
    return short_run()


@every_peer
def test_peer_finds_the_targets_as_unclassified_points_of_every_scan(contender, run):
    tracks = contender(run, NOISE, (0, LAG)).tracks
    assert set(tracks) == ({0, LAG} if contender.smoothed else {0})
    for points in tracks.values():
        assert missed(run, points) <= 1
        # There is at most one false target in a few scans.
        assert sum(map(len, points)) <= SCANS * len(run.truth[0].state) + 3
        assert len(points) == SCANS
        for found in points:
            assert found.position.shape == (len(found), 2)
            assert found.position.dtype == np.float64
            np.testing.assert_array_equal(found.class_id, np.zeros(len(found)))


@every_peer
def test_peer_follows_a_target_along_the_cut_of_the_bearings(contender):
    # Target 1 flies towards the radars, whose x axes point away from it.
    run = short_run(yaws_deg=(-41.0, -44.0), targets=slice(1))
    azimuth = np.concatenate([d.measurement[:, 1] for s in run.scans for d in s.detections])
    assert np.count_nonzero(azimuth > 3.1) > SCANS // 2
    assert np.count_nonzero(azimuth < -3.1) > SCANS // 2
    for points in contender(run, NOISE, (0, LAG)).tracks.values():
        assert missed(run, points) == 0


def test_nearest_turn_is_less_than_half_a_turn_from_the_prediction():
    problem = Problem.of(short_run(), MODEL)
    stamp, looks = next(problem.scans())
    sensor = measurement_model(problem.soup, looks[0][0])
    place = problem.soup.GaussianState([-9000.0, 0.0, -1.0, 0.0], np.eye(4), timestamp=stamp)
    hypothesis = SimpleNamespace()
    hypothesis.measurement_prediction = problem.updater.predict_measurement(place, sensor)
    hypothesis.measurement = detection(problem.soup, np.array([1e4, 3.1]), stamp, sensor)
    moved = nearest_turn(problem.soup, hypothesis).state_vector
    np.testing.assert_allclose(
        np.asarray(moved, dtype=float)[:, 0], [3.1 - 2.0 * np.pi, 1e4], rtol=1e-12
    )


@pytest.fixture(scope="module")
def run_from_elsewhere():
    """A run whose target appears kilometres from all birth places."""
    scenario = short_run(targets=slice(1)).scenario
    away = replace(scenario.targets[0], position=(8e3, -6e3))
    return simulated_run(replace(scenario, targets=(away,)), seed=1)


def test_gnn_anywhere_starts_tracks_anywhere(run_from_elsewhere):
    found = peers.gnn(run_from_elsewhere, MODEL, ANYWHERE, (LAG,))[LAG]
    assert missed(run_from_elsewhere, found) <= 1


@pytest.mark.parametrize("name", ["gnn", "gnn_loud"])
def test_gnn_starts_tracks_at_birth_places_alone(name, run_from_elsewhere):
    (points,) = peers.PEERS[name](
        run_from_elsewhere, reference.parameters(), (LAG,)
    ).tracks.values()
    assert [len(found) for found in points] == [0] * SCANS


@pytest.mark.parametrize("name", [name for name, peer in peers.PEERS.items() if peer.loud])
def test_loud_peers_take_strong_detections_alone(name):
    run = short_run(clutter_rate=20.0)
    (whole,), (strong,) = (
        peers.PEERS[name](given, reference.parameters(), (0,)).tracks.values()
        for given in (run, raised_threshold(run, LOUD_THRESHOLD))
    )
    for found, expected in zip(whole, strong, strict=True):
        np.testing.assert_array_equal(found.position, expected.position)


def test_raised_threshold_drops_weak_detections_and_their_clutter():
    run = short_run(clutter_rate=20.0)
    loud = raised_threshold(run, 5.0)
    for scan, sources in zip(loud.scans, loud.sources, strict=True):
        for report, source in zip(scan.detections, sources, strict=True):
            assert np.all(report.amplitude > 5.0)
            assert len(source) == len(report)
    false = sum(np.count_nonzero(s == 0) for sources in loud.sources for s in sources)
    expected = loud.scenario.radars[0].clutter_rate * SCANS * len(loud.scenario.radars)
    assert abs(false - expected) < 4.0 * np.sqrt(expected) + 1.0


def test_raised_threshold_refuses_lower_ones_and_no_amplitudes():
    with pytest.raises(ValueError, match=r"threshold: 1\.0 given"):
        raised_threshold(short_run(), 1.0)
    run = short_run()
    first, *others = run.scans
    silent = replace(first, detections=(None, *first.detections[1:]))
    with pytest.raises(ValueError, match=f"scan of {first.stamp_ns} ns: a radar reports no ampl"):
        raised_threshold(replace(run, scans=(silent, *others)), 5.0)


def test_peers_name_what_to_install(monkeypatch):
    monkeypatch.setattr(soup, "PARTS", {"no_such_part": ("Anything",)})
    with pytest.raises(ImportError, match="pip install 'stonesoup"):
        peers.gm_phd(short_run(), MODEL)
