"""Known errors of simulated radars are found."""

from dataclasses import replace

import biased
import numpy as np
import pytest

from phd_jdtc_ros.calibration.registration import observability
from phd_jdtc_ros.calibration.registration.common import common_targets
from phd_jdtc_ros.calibration.registration.filtering import KINDS
from phd_jdtc_ros.calibration.registration.solution import register
from phd_jdtc_ros.calibration.registration.tracked_radars import RegistrationError
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, SensorBias

TRUE = SensorBias(80.0, 0.0, -np.radians(0.3), 0.5)
# Bounds for four minutes of fifteen aircraft; those for twenty minutes of fifty are a quarter of
# these.
BOUNDS = np.array([32.0, 5e-4, np.radians(0.04), 0.15])


@pytest.fixture(scope="module")
def sensors():
    return biased.sensors(biased.document(), seed=3)


@pytest.fixture(scope="module")
def found(sensors):
    return register(sensors, "west")


def numbers(bias):
    return np.array([getattr(bias, kind) for kind in KINDS])


def test_the_errors_of_one_radar_of_three_are_found_and_those_of_the_others_are_none(found):
    for each in found.radars:
        true = numbers(TRUE if each.name == "east" else NO_BIAS)
        off = np.abs(numbers(each.bias) - true)
        told = np.isfinite(each.std)
        assert (off[told] < BOUNDS[told]).all(), each.name
        # Errors are within four standard deviations, and these are not arbitrary.
        assert (off[told] < 4.0 * each.std[told]).all(), each.name
        assert (each.std[told] < BOUNDS[told]).all(), each.name
        assert each.plots > 300


def test_a_time_offset_is_observable_relative_to_the_reference_only(found, sensors):
    assert found.common == ("time_offset_s",)
    assert not found.hidden
    assert np.isnan(found.radars[0].std[3])
    assert found.radars[0].bias.time_offset_s == 0.0
    other = register(sensors, "east")
    west = other.radars[0].bias.time_offset_s
    assert west == pytest.approx(-found.radars[1].bias.time_offset_s, abs=0.02)
    # A radar's position and yaw are observable all the same.
    assert other.radars[1].bias.azimuth == pytest.approx(found.radars[1].bias.azimuth, abs=1e-4)


def test_residuals_have_errors_that_are_found_once_and_removed(found, sensors):
    east = found.radars[1]
    before, after = east.residuals.before, east.residuals.after
    assert before.shape == after.shape == (east.plots, 2)
    mean = np.sqrt(np.mean(before**2, axis=0))
    rest = np.sqrt(np.mean(after**2, axis=0))
    assert rest[0] < 70.0 < mean[0]
    assert rest[1] < np.radians(0.12) < np.radians(0.28) < mean[1]
    right = []
    for each, known in zip(sensors, found.radars, strict=True):
        plots = each.remove_bias(known.bias)
        right.append(replace(each, time_s=plots.time_s, measurement=plots.measurement))
    again = register(right, "west")
    for each in again.radars:
        told = np.isfinite(each.std)
        assert (np.abs(numbers(each.bias)[told]) < 0.5 * each.std[told]).all(), each.name


def test_a_wrong_yaw_is_found_as_an_error_of_the_azimuth(sensors):
    turned = np.radians(0.8)
    south = sensors[2]
    wrong = replace(south, pose=south.pose + np.array([0.0, 0.0, turned]))
    again = register([*sensors[:2], wrong], "west")
    assert again.radars[2].bias.azimuth == pytest.approx(turned, abs=BOUNDS[2])


def test_common_biases_of_radars_at_one_place_are_not_observable():
    given = biased.document(scans=151)
    for name in ("east", "south"):
        given["parameters"][name]["position"] = given["parameters"]["west"]["position"]
    found = register(biased.sensors(given, seed=4), "west")
    assert {"azimuth", "time_offset_s"} <= set(found.common)
    assert found.radars[0].bias.azimuth == 0.0
    east = found.radars[1]
    assert abs(np.degrees(east.bias.azimuth) + 0.3) < 0.04
    assert abs(east.bias.time_offset_s - 0.5) < 0.15


def test_radars_that_see_nothing_together_are_refused(sensors):
    far = replace(sensors[1], pose=sensors[1].pose + np.array([4e5, 0.0, 0.0]))
    with pytest.raises(RegistrationError, match=r"no common targets: east has \d+ tracks"):
        register([sensors[0], far, sensors[2]], "west")
    shifts = 4e5 * np.eye(3)[:2]
    lost = [replace(sensors[k], pose=sensors[k].pose + shift) for k, shift in enumerate(shifts)]
    with pytest.raises(RegistrationError, match=r"no common targets: west has \d+ tracks, none"):
        register([lost[0], *sensors[1:]], "west")
    with pytest.raises(RegistrationError, match=r"targets: west has .*; east has .*; south has"):
        register([*lost, sensors[2]], "west")
    later = replace(sensors[1], time_s=sensors[1].time_s + 1e4)
    with pytest.raises(RegistrationError, match="in the 0 s covered by all radars"):
        register([sensors[0], later], "west")


@pytest.mark.filterwarnings("error")
def test_nothing_observable_is_said_without_warnings(sensors, monkeypatch):
    monkeypatch.setattr(observability, "OBSERVABLE_SHARE", 1e-9)
    with pytest.raises(RegistrationError, match="east: no bias is observable"):
        register(sensors[:2], "west")


def test_targets_that_both_see_are_joined_and_no_radar_has_two_at_a_time(sensors, found):
    biases = [each.bias for each in found.radars]
    targets = common_targets(sensors, biases, known=True)
    assert len(targets) >= 10
    for target in targets:
        assert len({radar for radar, _ in target}) > 1
        for radar in range(3):
            spans = sorted(
                (sensors[radar].time_s[own[0]], sensors[radar].time_s[own[-1]])
                for r, row in target
                if r == radar
                for own in [sensors[radar].tracks[row]]
            )
            ends = [end for _, end in spans]
            assert all(begin >= end for (begin, _), end in zip(spans[1:], ends, strict=False))
