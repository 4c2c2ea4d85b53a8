"""Clutter that stays where it is."""

import numpy as np
import pytest
from runs import learned
from scenes import small

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors import ClutterMap
from phd_jdtc_ros.core.types import Detections, Pose, Scan
from phd_jdtc_ros.simulation.clutter import NOISE, LogNormalClutter
from phd_jdtc_ros.simulation.simulate import false_detections


def test_other_noise_keeps_the_map_and_its_cells():
    tracker = mapped()
    run = [scan for _, scan in harbour(4, 3)]
    for scan in run[:3]:
        tracker.step(scan)
    before = learned(tracker, ClutterMap)["mast"]
    other = small({**HARBOUR, **MAPPED, "mast.range_std": 25.0})
    tracker.retune(other.model, tracker.rule)
    tracker.step(run[3])
    after = learned(tracker, ClutterMap)["mast"]
    assert after.grid == before.grid
    assert len(after.cell) > len(before.cell)


# A radar at a harbour: a quay of forty reflectors at 4 km, and three ships that move.
HARBOUR = {
    "sensors": ["mast"],
    "births": [],
    "interval_s": 2.5,
    "lag": 0,
    "detection_births.rates": [0.02, 0.02],
    "detection_births.std": [8.0],
    "cv.noise_density": 0.02,
    "ct.noise_density": 0.02,
    "spawn.rate": 0.0,
    "mast.range_std": 10.0,
    "mast.azimuth_std_deg": 0.2,
    "mast.max_range": 20e3,
    "mast.clutter_max_range": 20e3,
    "mast.clutter_rate": 10.0,
    "mast.clutter_amplitude": "learned",
    "mast.detection_probability": 0.9,
}

MAPPED = {"mast.clutter_map": True}

START = np.array([[-3000.0, 2500.0], [2000.0, 6000.0], [-1000.0, 5200.0]])

VELOCITY = np.array([[6.0, 2.0], [-4.0, -5.0], [3.0, -7.0]])

SLOW_START = np.array([[4500.0, -5500.0], [-5000.0, -6000.0], [1000.0, 9000.0]])

SLOW_VELOCITY = np.array([[-2.0, 4.0], [3.0, 3.0], [3.5, -2.0]])


def harbour(count, seed, poses=None, course=(START, VELOCITY)):
    """Return where the ships are and what the radar reports, revolution by revolution."""
    rng = np.random.default_rng(seed)
    mast = small(HARBOUR).model.radars[0]
    east = np.linspace(-1500.0, 1500.0, 40)
    quay = np.stack([east, 4000.0 + rng.uniform(-20.0, 20.0, 40)], axis=1)
    run = []
    for revolution in range(count):
        ships = course[0] + 2.5 * revolution * course[1]
        pose = None if poses is None else poses[revolution]
        radar = mast.at(pose)
        seen = np.concatenate([quay[rng.random(40) < 0.7], ships[rng.random(3) < 0.9]])
        state = np.zeros((len(seen), 5))
        state[:, [0, 2]] = seen
        found = radar.measure(state) + rng.standard_normal((len(seen), 2)) * radar.noise_std
        false, amplitude = false_detections(radar, rng.poisson(10.0), rng, NOISE)
        high = LogNormalClutter(16.0, 5.0).draw(radar.threshold, len(seen), rng)
        report = Detections(
            np.concatenate([found, false]), np.concatenate([high, amplitude]), pose=pose
        )
        run.append((ships, Scan((revolution + 1) * 2_500_000_000, (report,))))
    return run


def followed(count, poses=None, course=(START, VELOCITY), **given):
    """Return by revolution how many tracks there are on the quay, and how many ships are found."""
    tracker = new_engine(small({**HARBOUR, **given}))
    quay, ships = [], []
    for true, scan in harbour(count, 1, poses, course):
        place = tracker.step(scan).filtered[0].position
        away = np.hypot(*(place[:, None] - true).transpose(2, 0, 1)).reshape(len(place), 3)
        there = (np.abs(place[:, 1] - 4000.0) < 150.0) & (np.abs(place[:, 0]) < 1700.0)
        quay.append(int(np.count_nonzero(there & (away.min(axis=1, initial=1e9) > 100.0))))
        ships.append(int(np.count_nonzero(away.min(axis=0, initial=1e9) < 100.0)))
    return np.array(quay), np.array(ships)


@pytest.mark.parametrize("moves", [False, True], ids=["fixed", "on a ship that turns"])
def test_a_quay_becomes_no_targets_and_hides_no_ships(moves):
    poses = (
        [
            Pose((10.0 * revolution, -4.0 * revolution), 0.03 * revolution)
            for revolution in range(50)
        ]
        if moves
        else None
    )
    given = {"mast.pose": "/ship/odometry"} if moves else {}
    plain, _ = followed(10, poses, **given)
    assert plain[-1] > 15
    quay, ships = followed(50, poses, **given, **MAPPED)
    assert quay[20:].max() <= 1
    assert quay[30:].max() == 0
    # Each is detected in nine revolutions of ten.
    assert ships[5:].mean() > 2.85


def test_slow_ships_are_reported_at_once_and_do_not_hide_behind_their_own_detections():
    """They move by a third of a cell in a revolution."""
    quay, ships = followed(25, course=(SLOW_START, SLOW_VELOCITY), **MAPPED)
    assert ships[10:].mean() > 2.7
    # They are alone at sea, and tracked from the second detection on.
    assert ships[1:6].min() == 3
    assert quay[:16].sum() < 60


@pytest.mark.parametrize("bound", [2.5, 0.0])
def test_rain_that_begins_and_moves_makes_no_targets_and_hides_no_ships(bound):
    """The revolutions before are dry, and tracks born in it claim most of its detections."""
    given = {**HARBOUR, **MAPPED, "amplitude": "none"}
    given["mast.clutter_map_speed"] = bound
    tracker, rng, false, seen = new_engine(small(given)), np.random.default_rng(6), [], []
    mast = small(HARBOUR).model.radars[0]
    for revolution in range(50):
        ships = START + 2.5 * revolution * VELOCITY
        place = [ships[rng.random(3) < 0.9]]
        if revolution >= 25:
            centre = np.array([5000.0 - 30.0 * revolution, -5000.0])
            place.append(centre + 500.0 * rng.standard_normal((rng.poisson(20.0), 2)))
        state = np.zeros((sum(map(len, place)), 5))
        state[:, [0, 2]] = np.concatenate(place)
        found = mast.measure(state)
        found += rng.standard_normal(found.shape) * mast.noise_std
        noise, _ = false_detections(mast, rng.poisson(10.0), rng, NOISE)
        report = Detections(np.concatenate([found, noise]), None)
        position = (
            tracker.step(Scan((revolution + 1) * 2_500_000_000, (report,))).filtered[0].position
        )
        away = np.hypot(*(position[:, None] - ships).transpose(2, 0, 1)).reshape(-1, 3)
        false.append(int(np.count_nonzero(away.min(axis=1) > 200.0)))
        seen.append(int(np.count_nonzero(away.min(axis=0, initial=1e9) < 200.0)))
    # By the average over all remembered revolutions, it is 47 and more.
    assert sum(false) < 10
    assert np.mean(seen[5:]) > 2.85


def test_targets_at_rest_stay_if_they_may():
    anchored = START, 0.0 * VELOCITY
    _, ships = followed(20, course=anchored, **MAPPED)
    assert ships[-5:].max() == 0
    _, stayed = followed(20, course=anchored, **MAPPED, **{"mast.clutter_map_speed": 0.0})
    assert stayed[-5:].mean() > 2.5


@pytest.mark.parametrize(("bound", "expected"), [(2.5, 0), (0.0, 3)])
def test_ships_at_rest_that_are_missed_at_first_are_found_if_they_may_be(bound, expected):
    """Their first detections are no clutter that explains the later ones."""
    given = {
        **HARBOUR,
        **MAPPED,
        "mast.clutter_map_speed": bound,
        "detection_births.rates": [0.1, 0.1],
        "detection_births.least_probability": 0.005,
    }
    tracker, rng = new_engine(small(given)), np.random.default_rng(3)
    mast = small(given).model.radars[0]
    state = np.zeros((3, 5))
    state[:, [0, 2]] = START
    place = mast.measure(state)
    found = []
    for revolution in range(25):
        seen = place[: 0 if revolution == 1 else None]
        seen = seen + rng.standard_normal(seen.shape) * mast.noise_std
        false, _ = false_detections(mast, rng.poisson(10.0), rng, NOISE)
        report = Detections(np.concatenate([seen, false]), None)
        ships = tracker.step(Scan((revolution + 1) * 2_500_000_000, (report,))).filtered[0].position
        away = np.hypot(*(ships[:, None] - START).transpose(2, 0, 1)).reshape(-1, 3)
        found.append(int(np.count_nonzero(away.min(axis=0, initial=1e9) < 200.0)))
    assert max(found[-5:]) == min(found[-5:]) == expected


def mapped(**given):
    return new_engine(small({**HARBOUR, **MAPPED, **given}))


@pytest.fixture(scope="module")
def map_stored():
    tracker = mapped()
    for _, scan in harbour(4, 3):
        tracker.step(scan)
    return tracker.snapshot()


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"mast.position": [50.0, 0.0]}, "of a radar at"),
        ({"mast.pose": "/ship/odometry"}, "map of a fixed radar given, but this radar is moving"),
    ],
)
def test_a_map_is_refused_by_a_radar_that_is_elsewhere(given, reason, map_stored):
    with pytest.raises(ValueError, match=reason):
        mapped(**given).restore(map_stored)
