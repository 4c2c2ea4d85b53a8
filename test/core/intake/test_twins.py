"""Detections that are reported several times, a little apart."""

import numpy as np
import pytest
from scenes import small

from phd_jdtc_ros.core.intake.input_checks import TwinCheck
from phd_jdtc_ros.core.types import Detections

STD = np.array([50.0, 0.005])
GIVEN = {"radar_1.range_std": 50.0, "radar_1.azimuth_std_deg": float(np.degrees(0.005))}


def counted(reports, **given):
    """Return the number of twins in reports, each of (range, azimuth) rows."""
    radar = small({**GIVEN, **{f"radar_1.{name}": value for name, value in given.items()}})
    check = TwinCheck()
    return sum(check.add(Detections(each, None), radar.model.radars[0]) for each in reports)


def scans(second, seed, count=60):
    """Return reports of ten detections; `second` makes a second one of each target's places."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        place = rng.uniform([1e3, -3.0], [2e4, 3.0], (10, 2))
        first = place + STD * rng.standard_normal((10, 2))
        yield np.concatenate([first, second(rng, place, first)])


def test_detections_reported_twice_are_counted():
    jitter = scans(lambda rng, place, first: first + [0.02, 0.0] * rng.standard_normal((10, 2)), 1)
    assert counted(jitter) == 1200
    some = scans(lambda rng, place, first: first[:4] + np.array([0.5, 1e-4]), 2)
    assert 0.8 * 480 < counted(some) < 1.2 * 480


def test_independent_detections_of_one_target_are_counted():
    own = scans(lambda rng, place, first: place + STD * rng.standard_normal((10, 2)), 3)
    assert counted(own) > 300


@pytest.mark.parametrize(
    "second",
    [
        lambda rng, place, first: rng.uniform([1e3, -3.0], [2e4, 3.0], (10, 2)),
        # Pairs of targets side by side.
        lambda rng, place, first: place + STD * rng.normal([3.0, 0.0], 1.0, (10, 2)),
    ],
    ids=["other targets", "pairs"],
)
def test_other_targets_are_no_twins(second):
    assert counted(scans(second, 4)) == 0


def test_many_false_detections_are_no_twins():
    rng = np.random.default_rng(5)
    assert counted(rng.uniform([0.0, -3.14], [3e3, 3.14], (300, 2)) for _ in range(20)) == 0


def test_merged_detections_are_no_twins():
    reports = scans(lambda rng, place, first: first + np.array([0.1, 0.0]), 6)
    assert counted(reports, cluster_distance=5.0) == 0
