"""Aircraft that fly on where no radar sees them, with the motions of the profile for aircraft."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from phd_jdtc_ros import Tracker, resources

PERIOD_S = 4.0


def aircraft(seed, turn_rate):
    """Return the detections of three aircraft abreast, and their states and visibility by time.

    They turn at a rate and back while they are seen, and fly straight on at 250 m/s through a blind
    arc of 60 degrees, north of the radar, in 92, 106 and 120 s.
    """
    rng = np.random.default_rng(seed)
    place = np.array([[30e3, y] for y in (20e3, 23e3, 26e3)])
    velocity = np.tile([-250.0, 0.0], (3, 1))
    rows, truth = [], {}
    for time in np.arange(0.0, 240.0, PERIOD_S):
        angle = PERIOD_S * turn_rate * ((time < 20.0) - 1.0 * (20.0 <= time < 40.0))
        turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        velocity = velocity @ turned.T
        place = place + PERIOD_S * velocity
        azimuth = np.arctan2(place[:, 1], place[:, 0])
        seen = np.abs(azimuth - np.pi / 2.0) > np.radians(30.0)
        truth[time] = place, seen
        detected = seen & (rng.random(3) < 0.95)
        measured = np.hypot(*place.T) + rng.normal(0.0, 45.0, 3)
        found = azimuth + rng.normal(0.0, np.radians(0.1), 3)
        rows += [*np.column_stack([np.full(3, time), measured, found])[detected]]
        rows += [(time, rng.uniform(5e2, 5e4), rng.uniform(-0.5, 0.5)), (time, np.nan, np.nan)]
    return dict(zip(("time", "range", "azimuth"), np.array(rows).T, strict=True)), truth


def parameters():
    (document,) = yaml.safe_load(
        resources.find(Path("config/air_traffic.yaml")).read_text()
    ).values()
    given = {**document["ros__parameters"], "coasting": [60, 1e6]}
    approach = {**given["approach"], "units.azimuth_convention": "enu_ccw", "rotation_s": 0.0}
    approach |= {"fields": {"range": "range", "azimuth": "azimuth", "amplitude": ""}}
    approach |= {"blind_sectors_deg": [60.0, 120.0], "clutter_rate": 1.0, "learn": []}
    return {**given, "approach": approach, "estimates_period_s": 0.0}


@pytest.mark.parametrize(("seed", "turn_rate"), [(0, 0.0), (1, 0.0), (2, 0.01)])
def test_aircraft_keep_speed_and_number_through_a_blind_arc(seed, turn_rate):
    detections, truth = aircraft(seed, turn_rate)
    tracks = Tracker(parameters()).track(detections).filtered
    number, since, coasted = {}, np.zeros(3), 0
    for time, (place, seen) in truth.items():
        here = tracks[np.abs(tracks["time"] - time) < 1e-3]
        since = np.where(seen, np.minimum(since, 0.0) - PERIOD_S, np.maximum(since, 0.0) + PERIOD_S)
        for target in range(3) if time > 45.0 else ():
            away = np.hypot(here["x"] - place[target, 0], here["y"] - place[target, 1])
            if since[target] < -20.0:
                nearest = here[away.argmin()]
                assert nearest["label"] == number.setdefault(target, nearest["label"])
                assert away.min() < 500.0
            elif 0.0 < since[target] < 80.0:
                (track,) = here[here["label"] == number[target]]
                assert np.hypot(track["vx"], track["vy"]) == pytest.approx(250.0, abs=12.0)
                off = np.array([track["x"], track["y"]]) - place[target]
                spread = track["covariance"][np.ix_([0, 1], [0, 1])]
                assert off @ np.linalg.solve(spread, off) < 11.8
                coasted += 1
    assert coasted > 50


def test_a_smoothed_track_begins_at_a_first_detection_that_a_miss_follows():
    rng, times = np.random.default_rng(3), np.arange(0.0, 48.0, PERIOD_S)
    place = np.array([12e3, 15e3]) + times[:, None] * [150.0, -100.0]
    true = np.array([times, np.hypot(*place.T), np.arctan2(place[:, 1], place[:, 0])]).T
    noise = rng.normal(0.0, [0.0, 45.0, np.radians(0.08)], true.shape)
    # The false detections are elsewhere.
    false = [(time, rng.uniform(5e2, 1.1e5), rng.uniform(2.5, 5.5)) for time in times.repeat(20)]
    rows = np.concatenate([np.delete(true + noise, 1, axis=0), false]).T
    detections = dict(zip(("time", "range", "azimuth"), rows, strict=True))
    given = {**parameters()}
    given["approach"] = {**given["approach"], "clutter_rate": 20.0, "blind_sectors_deg": []}
    tracks = Tracker(given).track(detections).smoothed
    assert np.isin(times[:-1], tracks["time"]).all()
    begin = tracks[tracks["time"] == 0.0]
    assert np.hypot(begin["x"] - place[0, 0], begin["y"] - place[0, 1]).min() < 200.0
