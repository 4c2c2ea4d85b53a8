"""Targets at rest have tracks; they are reported when they move, or where no map hides them."""

from dataclasses import replace

import numpy as np
import pytest
from inner import resolve
from track_inputs import estimates_of, scan_of, views_of

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors import ClutterMap
from phd_jdtc_ros.core.tracks.confirmation import TrackStates
from phd_jdtc_ros.core.tracks.reporting_rule import rule_of
from phd_jdtc_ros.core.types import Detections, Scan

REVOLUTION_NS = 1_680_000_000
SCANS = 45
SETS_OFF = 22
# Where the reflector, the boat that moves and the boat that sets off are at first, metres.
REFLECTOR, BOAT, MOORED = (100.0, 300.0), (-200.0, 150.0), (150.0, -200.0)
HARBOUR = {
    "sensors": ["radar"],
    "classes": ["vessel", "fixed"],
    "motions": ["cv", "rest"],
    "interval_s": 1.68,
    "lag": 3,
    "births": [],
    "spawn.rate": 0.0,
    "amplitude": "none",
    "vessel.motions": ["cv"],
    "vessel.mode_transition": [1.0],
    "vessel.survival_probability": 0.98,
    "cv.noise_density": 0.1,
    "fixed.motions": ["rest"],
    "fixed.mode_transition": [1.0],
    "fixed.survival_probability": 0.98,
    "rest.model": "stationary",
    "rest.noise_density": 0.01,
    "detection_births.rates": [0.05, 0.05],
    "detection_births.std": [5.0],
    "radar.range_std": 5.0,
    "radar.azimuth_std_deg": 1.0,
    "radar.max_range": 500.0,
    "radar.clutter_max_range": 500.0,
    "radar.clutter_rate": 1.0,
    "radar.detection_probability": 0.9,
}
SECOND = 1_000_000_000
# One radar with a map of clutter; targets are born at detections, at up to 10 m/s.
COAST = {
    "sensors": ["mast"],
    "births": [],
    "interval_s": 2.5,
    "detection_births.rates": [0.02, 0.02],
    "detection_births.std": [5.0],
    "mast.clutter_map": True,
    "mast.clutter_rate": 1.0,
    "mast.clutter_map_speed": 2.5,
}
# Unknown, moving, unknown again, at rest, moving again.
VELOCITIES = [(0.0, 5.0), (6.0, 2.0), (2.5, 4.0), (0.3, 0.5), (4.0, 0.5)]


def scans_of(seed):
    """Return scans of a reflector, a boat that moves at 4 m/s, and one that sets off later."""
    rng = np.random.default_rng(seed)
    scans = []
    for index in range(SCANS):
        moored = MOORED[0] - 4.0 * 1.68 * max(index - SETS_OFF, 0), MOORED[1]
        boat = BOAT[0] + 4.0 * 1.68 * index, BOAT[1]
        places = [place for place in (REFLECTOR, boat, moored) if rng.random() < 0.9]
        measured = [(np.hypot(x, y), np.arctan2(y, x)) for x, y in places]
        noise = rng.standard_normal((len(measured), 2)) * [5.0, np.radians(1.0)]
        false = rng.uniform([0.0, -np.pi], [500.0, np.pi], (rng.poisson(1.0), 2))
        found = np.concatenate([np.reshape(measured, (-1, 2)) + noise, false])
        scans.append(Scan(REVOLUTION_NS * (index + 1), (Detections(found, None),)))
    return scans


def near(estimates, place, within=40.0):
    return bool((np.hypot(*(estimates.position - place).T) < within).any())


def reported(seed, **changes):
    """Return the shares of scans with estimates of each target, once their tracks are old enough.

    The targets are the reflector (filtered, smoothed), the boat, and the moored boat before and
    after it sets off.
    """
    tracker = new_engine(resolve({**HARBOUR, **changes}))
    steps = [tracker.step(scan) for scan in scans_of(seed)]
    filtered = [found for step in steps for found in step.filtered]
    smoothed = [found for step in steps for found in step.smoothed]
    indices = np.arange(SCANS)
    boat = BOAT[0] + 4.0 * 1.68 * indices
    left = MOORED[0] - 4.0 * 1.68 * np.maximum(indices - SETS_OFF, 0)
    away = SETS_OFF + 12
    return (
        np.mean([near(found, REFLECTOR) for found in filtered[8:]]),
        np.mean([near(found, REFLECTOR) for found in smoothed[8:]]),
        np.mean([near(filtered[i], (boat[i], BOAT[1])) for i in indices[8:]]),
        np.mean([near(found, MOORED) for found in filtered[8:SETS_OFF]]),
        np.mean([near(filtered[i], (left[i], MOORED[1])) for i in indices[away:]]),
    )


def test_only_what_moves_is_reported():
    shares = np.mean([reported(seed) for seed in range(4)], axis=0)
    reflector, reflector_smoothed, boat, moored, left = shares
    assert max(reflector, reflector_smoothed, moored) < 0.02
    assert min(boat, left) > 0.9


def test_what_rests_is_reported_if_asked_for():
    assert min(reported(7, report_resting=True)) > 0.9


def test_a_class_at_rest_is_not_reported_without_labels_either():
    # Births where the boat, the moored boat and the reflector are.
    places = {"boat": BOAT, "moored": MOORED, "reflector": REFLECTOR}
    births = {"births": [*places], "detection_births.rates": []}
    for name, place in places.items():
        births |= {f"{name}.position": [*place], f"{name}.std": [10.0, 5.0, 1e-3]}
        births |= {f"{name}.rates": [0.05, 0.05]}
    config = resolve({**HARBOUR, **births, "engine": "phd"})
    tracker = new_engine(config)
    steps = [tracker.step(scan) for scan in scans_of(5)]
    found = [found for step in steps for found in (*step.filtered, *step.smoothed)]
    assert sum(map(len, found)) > SCANS
    assert all((each.class_id == 0).all() for each in found)


def test_a_class_that_can_move_is_reported():
    still = {"vessel.motions": ["cv", "rest"], "vessel.mode_transition": [0.9, 0.1, 0.1, 0.9]}
    assert rule_of(resolve({**HARBOUR, **still}).model, True).reported.tolist() == [True, False]


def moving(states, model, stamp_ns, speed, std):
    """Return the state of a certain track with such a velocity, if it is reported."""
    found = estimates_of(stamp_ns, {1: 0.999}, model=model)
    state, covariance = found.state.copy(), found.covariance.copy()
    axes = list(model.modes.space.velocity)
    state[:, axes] = [speed, 0.0]
    covariance[:, axes, axes] = std**2
    found = replace(found, state=state, covariance=covariance)
    reported = states.report_filtered(
        found, np.array([0]), [], scan_of(stamp_ns, model), model, views_of(model)
    )
    return reported.track_state.tolist()


def states_by_scan(model):
    """Return whether a track with these velocities is reported, scan by scan."""
    states = TrackStates(rule_of(model, True))
    return [
        bool(moving(states, model, (index + 1) * SECOND, *velocity))
        for index, velocity in enumerate(VELOCITIES)
    ]


def with_answers(model, answers):
    """Return the model with a map of a quay at 5 km, of reflectors that answer every revolution."""
    (radar,) = model.radars
    (places,) = (each for each in model.factors[radar.name] if isinstance(each, ClutterMap))
    azimuth = 2.0 * np.pi / places.grid.columns * (4 + np.arange(answers))
    seen = np.stack([np.full(answers, 5e3), azimuth], axis=1)
    for _ in range(4):
        places = places.after(seen, radar.to_world(seen), np.ones(answers), 1.0)
    factors = [places if isinstance(f, ClutterMap) else f for f in model.factors[radar.name]]
    return replace(model, factors={radar.name: tuple(factors)})


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, [True, True, True, False, True]),
        ({"mast.clutter_map": False}, [True] * 5),
        ({"mast.clutter_map_speed": 0.0}, [True] * 5),
    ],
)
def test_where_there_is_a_map_of_clutter_tracks_at_rest_are_not_reported(given, expected):
    assert states_by_scan(resolve({**COAST, **given}).model) == expected


@pytest.mark.parametrize(
    ("given", "expected"),
    [({}, [False, True, False, False, True]), ({"mast.clutter_map_speed": 0.0}, [True] * 5)],
)
def test_among_reflectors_only_tracks_in_evident_motion_are_reported(given, expected):
    model = resolve({**COAST, **given}).model
    assert states_by_scan(with_answers(model, 5)) == expected
    # One reply beside it makes no quay.
    alone = states_by_scan(model)
    assert states_by_scan(with_answers(model, 1)) == alone


def test_a_radar_that_does_not_see_a_place_leaves_its_neighbourhood():
    near = with_answers(resolve(COAST).model, 5)
    far = {"far.clutter_map": True, "far.position": [6e4, 0.0], "far.max_range": 2e4}
    both = resolve({**COAST, **far, "sensors": ["mast", "far"]}).model
    both = replace(both, factors={**both.factors, **near.factors})
    assert states_by_scan(both) == states_by_scan(near)
