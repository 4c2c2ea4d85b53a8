"""A driver's clouds of x, y and z, with nothing set: found in a table and in a bag, and tracked."""

import numpy as np
import pytest
import street
from bag_content import recorded, write

from msg_adapters.encoding import point_cloud
from phd_jdtc_ros import Tracker, evaluate
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.core.types import FILTERED
from phd_jdtc_ros.parameter_files import bag_parameters

TOPIC, FRAME = "/lidar/objects", "velodyne"
SEEDS = (71, 72, 73)


def scores_of(tracks, seed):
    """Return the scores, and the share of the targets that is found in a scan."""
    truth = street.true_tracks(seed)
    scores = evaluate(truth, tracks, cutoff=1.0, times=street.TIMES)
    return scores, 1.0 - scores["missed"] * len(street.TIMES) / len(truth["time"])


@pytest.mark.parametrize("seed", SEEDS)
def test_people_and_cars_of_a_table_are_found_and_nobody_is_hidden(seed):
    table = street.table(seed)
    tracker = Tracker().fit(table)
    found = tracker.parameters
    assert found["radar.kind"] == "position"
    assert found["radar.position_std"] == pytest.approx(street.STD, rel=0.1)
    assert found["radar.detection_probability"] == pytest.approx(street.DETECTED, abs=0.02)
    assert found["radar.clutter_rate"] == pytest.approx(street.FALSE, rel=0.2)
    x_min, y_min, x_max, y_max = found["radar.area"]
    np.testing.assert_allclose([x_max, y_max], street.EXTENT, rtol=0.05)
    np.testing.assert_allclose([x_min, y_min], -street.EXTENT, rtol=0.05)
    tracks = tracker.track(table)
    for found_tracks in tracks:
        scores, share = scores_of(found_tracks, seed)
        assert share >= 0.99
        assert scores["identity_switches"] == 0
        assert scores["false"] < 0.05
        assert scores["position_rms"] < 0.8 * np.sqrt(2.0) * street.STD
    # Those who stand, and the one at the sensor itself, have a track of their own at the end.
    last = tracks.filtered[tracks.filtered["time"] == tracks.filtered["time"].max()]
    for x, y in street.STANDING:
        assert np.hypot(last["x"] - x, last["y"] - y).min() < 0.2
    at_sensor = np.hypot(tracks.smoothed["x"], tracks.smoothed["y"]) < 1.0
    assert len({*tracks.smoothed["label"][at_sensor].tolist()}) == 1
    assert np.count_nonzero(at_sensor) > 20


def strollers(seed):
    """Return detections and truth of people who stroll and stand, seen once a second."""
    rng, times = np.random.default_rng([seed, 3]), np.arange(150.0)
    speed, course, turn = rng.uniform(0.8, 1.8, 6), rng.uniform(-np.pi, np.pi, 6), np.zeros(6)
    walking, standing = (rng.uniform(-20.0, 20.0, (count, 2)) for count in (6, 5))
    rows, truth = [], []
    for time in times:
        change = rng.random(6) < 0.1
        turn = np.where(change, rng.choice([-0.5, 0.0, 0.5], 6), turn)
        off = np.arctan2(-walking[:, 1], -walking[:, 0]) - course
        inwards = 0.5 * np.sign(np.sin(off)) * (np.cos(off) < 0.7)
        course = course + np.where(np.abs(walking).max(axis=1) > 20.0, inwards, turn)
        walking = walking + speed[:, None] * np.stack([np.cos(course), np.sin(course)], axis=1)
        everybody = np.concatenate([walking, standing])
        truth += [(time, label, *each) for label, each in enumerate(everybody.tolist(), start=1)]
        seen = everybody[rng.random(len(everybody)) < 0.93]
        false = rng.uniform(-30.0, 30.0, (rng.poisson(2.0), 2))
        rows += [(time, *each) for each in seen + 0.08 * rng.standard_normal(seen.shape)]
        rows += [(time, *each) for each in false]
    names = "time", "label", "x", "y"
    detections = dict(zip(("time", "x", "y"), np.transpose(rows), strict=True))
    return detections, dict(zip(names, np.transpose(truth), strict=True))


@pytest.mark.parametrize("seed", SEEDS)
def test_people_who_stand_do_not_hide_how_others_turn(seed):
    detections, truth = strollers(seed)
    tracker = Tracker().fit(detections)
    assert tracker.parameters["hard.noise_density"] > 0.1
    tracks = tracker.track(detections).filtered
    scores = evaluate(truth, tracks, cutoff=1.5, times=np.unique(truth["time"]))
    assert scores["missed"] < 0.03 * 11
    assert scores["identity_switches"] < 5


def test_a_bag_of_such_clouds_is_tracked_with_nothing_set(tmp_path, capsys):
    seed, entries = SEEDS[0], []
    for time, points in zip(street.TIMES, street.clouds(seed), strict=True):
        stamp_ns = round(1e9 * (1000.0 + time))
        columns = dict(zip(("x", "y", "z"), points.T, strict=True))
        entries.append((TOPIC, point_cloud.to_cdr(stamp_ns, FRAME, columns), stamp_ns))
    bag, out = write(tmp_path / "recorded", [TOPIC], entries), tmp_path / "tracked"
    assert run("track_bag", [str(bag), "--out", str(out)]) == 0
    assert "has no parameters; its topics, fields and noise are found as by tune" in (
        capsys.readouterr().err
    )
    written = bag_parameters.read(out)
    assert written["sensors"] == ["lidar"]
    assert (written["lidar.kind"], written["lidar.frame"]) == ("position", FRAME)
    found = recorded(out, FILTERED)
    rows = [
        (each.stamp_ns * 1e-9 - 1000.0, label, *place)
        for each in found
        for label, place in zip(each.track_id, each.position, strict=True)
    ]
    columns = zip(("time", "label", "x", "y"), np.transpose(rows), strict=True)
    tracks = {name: np.round(column, 9) for name, column in columns}
    scores, share = scores_of(tracks, seed)
    assert share >= 0.99
    assert scores["identity_switches"] == 0
