"""Gaussians that are born at detections."""

import numpy as np
import pytest
from lone import BIRTHS, MEAN, STD, TWO_MOTIONS, lone, mixture_of, updated

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.models import detection_limit
from phd_jdtc_ros.core.tracks import labels
from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.core.window.update import update_scan


def scan_update(config, *reports, scan_index=4):
    """Return what the radars' reports make of nothing."""
    dynamics = Dynamics(config.model)
    nothing = mixture_of(dynamics, [(0.5, MEAN, STD)]).take(np.zeros(0, dtype=int))
    steps = GaussianSteps(dynamics, new_engine(config).forward.bounds)
    predicted = Branched(nothing, np.zeros(0, dtype=int))
    return update_scan(predicted, Scan(1, reports), steps, 6.0, scan_index).rows


@pytest.mark.parametrize("times", [None, [0.4, -1.5]], ids=["at the stamp", "with times"])
@pytest.mark.parametrize("own", [None, [[50.0, 0.03], [np.nan, 0.001]]], ids=["usual", "own"])
def test_newborn_is_at_its_detection_with_the_radars_noise_and_a_broad_velocity(times, own):
    config = lone({**TWO_MOTIONS, **BIRTHS})
    (radar,) = config.model.radars
    place = np.array([[7e3, 0.8], [4e3, -2.0]])
    report = Detections(place, None, time_s=times, noise_std=own)
    branched = scan_update(config, report)
    found = branched.mixture
    first = labels.first_detected(4)
    np.testing.assert_array_equal(found.row_label, [first, first + 1])
    np.testing.assert_array_equal(branched.parent, [-1, -1])
    usual = np.broadcast_to(radar.noise_std, (2, 2))
    std = usual if own is None else np.where(np.isnan(own), usual, own)
    for row in range(2):
        position = radar.to_world(place[row : row + 1])[0]
        # Derivatives of the position by range and azimuth, numerically.
        steps = np.diag([1e-3, 1e-7])
        jacobian = (radar.to_world(place[row] + steps) - position) / np.diag(steps)[:, None]
        expected = np.zeros((5, 5))
        expected[np.ix_([0, 2], [0, 2])] = jacobian.T @ np.diag(std[row] ** 2) @ jacobian
        expected[[1, 3], [1, 3]] = 35.0**2
        expected[4, 4] = 2e-3**2
        back = np.eye(5)
        back[[0, 2], [1, 3]] = 0.0 if times is None else -times[row]
        expected = back @ expected @ back.T
        straight = np.outer([1, 1, 1, 1, 0], [1, 1, 1, 1, 0])
        np.testing.assert_allclose(found.mean[row, :, [0, 2]], np.tile(position[:, None], 2))
        np.testing.assert_array_equal(found.mean[row][:, [1, 3, 4]], 0.0)
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        np.testing.assert_allclose(
            found.covariance[row, 0] / scale, expected * straight / scale, rtol=1e-4, atol=1e-9
        )
        np.testing.assert_allclose(
            found.covariance[row, 1] / scale, expected / scale, rtol=1e-4, atol=1e-9
        )


def test_newborns_of_a_radar_have_origins_after_those_of_the_radars_before():
    radars = {
        "sensors": ["radar", "other"],
        "radar.detection_probability": 0.5,
        "other.position": [1e4, 0.0],
        "other.detection_probability": 0.5,
        "other.clutter_rate": 1.0,
    }
    config = lone({**BIRTHS, **radars})
    one, two = config.model.radars
    points = np.zeros((5, 5))
    points[:, [0, 2]] = [[5e3, 0], [0, 5e3], [-5e3, 0], [0, -5e3], [5e3, 5e3]]
    reports = [Detections(r.measure(points[p]), None) for r, p in ((one, [0, 1, 2]), (two, [3, 4]))]
    first = labels.first_detected(4)
    found = scan_update(config, *reports).mixture
    np.testing.assert_array_equal(np.sort(found.row_label), first + np.arange(5))


def test_newborn_has_the_cells_of_its_class_that_its_amplitude_tells():
    config = lone(
        {
            **BIRTHS,
            "amplitude": "memory",
            "radar.detection_probability": 0.0,
            "target.snr_band_db": [5.0, 30.0],
        }
    )
    dynamics = Dynamics(config.model)
    assert dynamics.cells.log_snr.shape[1] > 5
    amplitude = np.array([5.0, 20.0])
    report = Detections(np.array([[7e3, 0.8], [4e3, -2.0]]), amplitude)
    found = scan_update(config, report).mixture
    # Rayleigh, with the power of noise and target; the detection's mass is that of the class.
    power = np.exp(dynamics.cells.log_snr)
    density = amplitude[:, None] / power * np.exp(-(amplitude[:, None] ** 2) / (2.0 * power))
    share = density / density.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(found.snr[:, 0], share, rtol=1e-6)
    assert abs(share.argmax(axis=1)[0] - share.argmax(axis=1)[1]) > 2


def test_detections_that_were_left_out_are_noted_with_the_newborn(monkeypatch):
    for limit in ("MAX_DETECTIONS", "MAX_UNEXPLAINED"):
        monkeypatch.setattr(detection_limit, limit, 2)
    config = lone({**BIRTHS})
    mixture = mixture_of(Dynamics(config.model), [(0.5, MEAN, STD)])
    report = Detections(np.array([[5e3, 0.1 * k] for k in range(8)]), None)
    _, newborn = updated(config, mixture, report)
    assert newborn.report.share == 0.25
