"""Elevations of a recording: their noise, their limits and the heights that they show."""

import dome
import numpy as np
import pytest
from lone import lone

from phd_jdtc_ros.calibration.tuning import proposal
from phd_jdtc_ros.calibration.tuning.findings import findings
from phd_jdtc_ros.calibration.tuning.plots import plots_of
from phd_jdtc_ros.calibration.tuning.unspecified import unspecified
from phd_jdtc_ros.core.sensors.gaussians import UNKNOWN_STD
from phd_jdtc_ros.core.types import Detections


def recorded(missing=0.2, looks=60, elevation_std=0.9):
    """Return reports of some targets amid clutter by a radar with noisier elevations."""
    config, rng = lone(dome.SPACE), np.random.default_rng(3)
    radar = config.model.radars[0].changed(elevation_std=np.radians(elevation_std))
    truth = dome.paths(config, rng, targets=8, scans=looks)
    reports = []
    for index, state in enumerate(truth):
        seen = dome.seen(radar, state[rng.random(len(state)) < 0.9], rng, missing)
        false = rng.uniform([500.0, -np.pi, -0.03], [2e4, np.pi, 1.0], (6, 3))
        measured = np.concatenate([seen.measurement, false])
        std = np.concatenate([seen.noise_std, np.full((6, 3), np.nan)])
        reports.append((10**12 + index * 10**9, Detections(measured, None, noise_std=std)))
    return reports


def test_noise_of_elevations_and_their_limits_are_found():
    found = findings(plots_of(recorded()))
    own = found.elevations
    assert np.degrees(own.noise.value) == pytest.approx(0.9, rel=0.15)
    assert abs(np.degrees(own.noise.value) - 0.9) < 4.0 * np.degrees(own.noise.std)
    # The range is not blamed for it.
    assert found.noise.range_std == pytest.approx(5.0, rel=0.2)
    assert found.noise.azimuth_std == pytest.approx(np.radians(0.5), rel=0.2)
    mean, std = own.heights
    assert mean == pytest.approx(1620.0, abs=400.0)
    assert 200.0 < std < 1000.0
    rows = {row.name: row for row in proposal.rows(found, {"engine": "gaussian"}, "radar")}
    assert rows["elevation_std_deg"].value == pytest.approx(0.9, rel=0.15)
    low, high = rows["fov_elevation_deg"].value
    assert -4.0 < low < 0.0
    assert 55.0 < high < 61.0
    known = {"radar.fov_elevation_deg": [-2.0, 62.0]}
    kept = {row.name: row for row in proposal.rows(found, known, "radar")}["fov_elevation_deg"]
    assert not kept.proposed
    prior = unspecified({"radar": found})["height_prior"]
    assert prior[0] == pytest.approx(mean, rel=0.05)
    assert prior[2] < 900.0


def test_radar_without_elevations_has_none_to_find():
    reports = [
        (stamp, found.changed(noise_std=np.tile([np.nan, np.nan, UNKNOWN_STD], (len(found), 1))))
        for stamp, found in recorded()
    ]
    assert plots_of(reports).elevation is None
    plane = [(stamp, Detections(own.measurement[:, :2].copy(), None)) for stamp, own in reports]
    assert plots_of(plane).elevation is None
