"""Registration: its filter's equations, the errors that it finds, and which are observable."""

from dataclasses import replace

import biased
import numpy as np
import pytest
from numpy.testing import assert_allclose

from phd_jdtc_ros.calibration.registration import solution
from phd_jdtc_ros.calibration.registration.common import (
    ANY_SPEED,
    ANYWHERE,
    KINDS,
    UNITS,
    RegistrationError,
    Sequences,
    Trajectories,
    common_targets,
    filter_targets,
    smooth_targets,
)
from phd_jdtc_ros.calibration.registration.solution import analyse, register
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, SensorBias

TRUE = SensorBias(80.0, 0.0, -np.radians(0.3), 0.5)
# Bounds for four minutes of fifteen aircraft; those for twenty minutes of fifty are a quarter of
# these.
BOUNDS = np.array([32.0, 5e-4, np.radians(0.04), 0.15])
DENSITY, STEPS, RADARS = 2.0, 12, 2
STD = np.array([[40.0, 1e-3], [70.0, 2e-3]])
PLACES = np.array([[0.0, 0.0], [30e3, -5e3]])
COUNT = len(KINDS)


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
        known = np.isfinite(each.std)
        assert (off[known] < BOUNDS[known]).all(), each.name
        # Errors are within four standard deviations, and these are not arbitrary.
        assert (off[known] < 4.0 * each.std[known]).all(), each.name
        assert (each.std[known] < BOUNDS[known]).all(), each.name
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
        known = np.isfinite(each.std)
        assert (np.abs(numbers(each.bias)[known]) < 0.5 * each.std[known]).all(), each.name


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
    monkeypatch.setattr(solution, "OBSERVABLE_SHARE", 1e-9)
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


@pytest.fixture(scope="module")
def rows():
    """Return the plots of one target, of two radars in turn, with irregular times."""
    rng = np.random.default_rng(5)
    time_s = np.cumsum(rng.uniform(0.5, 3.0, STEPS))
    radar = np.arange(STEPS) % RADARS
    position = np.array([8e3, 12e3]) + time_s[:, None] * [150.0, -90.0]
    line = position - PLACES[radar]
    measured = np.stack([np.hypot(*line.T), np.arctan2(line[:, 1], line[:, 0])], axis=1)
    measured += STD[radar] * rng.standard_normal((STEPS, 2))
    pose = np.column_stack([PLACES[radar], np.zeros(STEPS)])
    return Sequences(
        np.ones((STEPS, 1), dtype=bool),
        time_s[:, None],
        measured[:, None],
        pose[:, None],
        radar[:, None],
        np.arange(STEPS)[:, None],
        position[:, None],
        STD[radar][:, None],
    )


@pytest.fixture(scope="module")
def course(rows):
    return Trajectories(rows.position, np.broadcast_to([150.0, -90.0], rows.position.shape))


def dense(rows, course):
    """Return the covariance of all plots, their derivatives by the errors, and their residuals."""
    time_s = rows.time_s[:, 0]
    step = np.subtract.outer(time_s, time_s)
    prior = np.diag([ANYWHERE**2] * 2 + [ANY_SPEED**2] * 2)
    states = np.zeros((STEPS, 4, STEPS, 4))
    for i in range(STEPS):
        for j in range(STEPS):
            first, last = sorted((i, j))
            since = time_s[first] - time_s[0]
            noise = np.zeros((4, 4))
            noise[:2, :2] = np.eye(2) * DENSITY * since**3 / 3
            noise[:2, 2:] = noise[2:, :2] = np.eye(2) * DENSITY * since**2 / 2
            noise[2:, 2:] = np.eye(2) * DENSITY * since

            def moved(dt):
                matrix = np.eye(4)
                matrix[:2, 2:] = np.eye(2) * dt
                return matrix

            own = moved(since) @ prior @ moved(since).T + noise
            ahead = moved(time_s[last] - time_s[first]) @ own
            states[i, :, j] = ahead if i >= j else ahead.T
    assert_allclose(step, -step.T)
    slope, seen = np.zeros((2 * STEPS, 4 * STEPS)), np.zeros((2 * STEPS, RADARS * len(KINDS)))
    residual = np.zeros(2 * STEPS)
    for k in range(STEPS):
        east, north = course.position[k, 0] - rows.pose[k, 0, :2]
        distance = np.hypot(east, north)
        own = np.array([[east, north], [-north / distance, east / distance]]) / distance
        slope[2 * k : 2 * k + 2, 4 * k : 4 * k + 2] = own
        columns = np.array([[1, distance, 0, 0], [0, 0, 1, 0]], dtype=float)
        columns[:, 3] = -own @ course.velocity[k, 0]
        at = len(KINDS) * rows.radar[k, 0]
        seen[2 * k : 2 * k + 2, at : at + len(KINDS)] = columns * UNITS
        residual[2 * k : 2 * k + 2] = rows.measurement[k, 0] - [distance, np.arctan2(north, east)]
    # The filter begins at the course's first position, at rest.
    start = np.zeros(4 * STEPS)
    start[0::4], start[1::4] = course.position[0, 0]
    where = course.position[:, 0].reshape(STEPS, 2)
    off = np.zeros(4 * STEPS)
    off[0::4], off[1::4] = where.T
    residual += slope @ (off - start)
    covariance = slope @ states.reshape(4 * STEPS, 4 * STEPS) @ slope.T
    covariance += np.diag(np.ravel(rows.noise_std[:, 0] ** 2))
    return covariance, seen, residual, states, slope, start


def test_information_and_score_are_those_of_all_plots_at_once(rows, course):
    found = filter_targets(rows, course, DENSITY, np.ones((STEPS, 1)), RADARS)
    covariance, seen, residual, *_ = dense(rows, course)
    inverse = np.linalg.inv(covariance)
    expected = seen.T @ inverse @ seen
    scale = np.sqrt(np.diag(expected))
    assert_allclose(found.information / np.outer(scale, scale),
                    expected / np.outer(scale, scale), atol=2e-4)  # fmt: skip
    assert_allclose(found.score[0] / scale, seen.T @ inverse @ residual / scale, atol=2e-3)


def test_the_smoothed_course_is_the_mean_given_all_plots_and_the_errors(rows, course):
    found = filter_targets(rows, course, DENSITY, np.ones((STEPS, 1)), RADARS)
    errors = np.array([0.3, 0.0, -0.5, 1.0, -0.2, 0.0, 0.4, -1.0])
    got = smooth_targets(rows, found, errors, DENSITY)
    covariance, seen, residual, states, slope, start = dense(rows, course)
    gain = states.reshape(4 * STEPS, 4 * STEPS) @ slope.T @ np.linalg.inv(covariance)
    expected = (start + gain @ (residual - seen @ errors)).reshape(STEPS, 4)
    assert_allclose(got.position[:, 0], expected[:, :2], atol=0.5)
    assert_allclose(got.velocity[:, 0], expected[:, 2:], atol=0.2)


def test_padding_plots_have_no_effect(rows, course):
    def doubled(column):
        return np.concatenate([column, np.repeat(column[-1:], 5, axis=0)])

    longer = Sequences(*(doubled(getattr(rows, name)) for name in Sequences.__dataclass_fields__))
    there = longer.valid.copy()
    there[STEPS:] = False
    padded = Sequences(there, *list(vars(longer).values())[1:])
    further = Trajectories(doubled(course.position), doubled(course.velocity))
    short = filter_targets(rows, course, DENSITY, np.ones((STEPS, 1)), RADARS)
    long = filter_targets(padded, further, DENSITY, np.ones((STEPS + 5, 1)), RADARS)
    assert_allclose(long.information, short.information)
    assert long.log_likelihood == pytest.approx(short.log_likelihood)
    one, other = (smooth_targets(*p, np.zeros(8), DENSITY) for p in ((rows, short), (padded, long)))
    assert_allclose(other.position[:STEPS], one.position, rtol=1e-9)


def information(*directions, known=1e6):
    """Return the information of two radars on all but some directions."""
    found = known * np.eye(2 * COUNT)
    for direction in directions:
        unit = direction / np.linalg.norm(direction)
        # Earlier information on it is removed.
        found -= np.outer(found @ unit, unit @ found) / (unit @ found @ unit)
    return found


def both(kind):
    """Return the direction of an error that is common to both radars."""
    direction = np.zeros(2 * COUNT)
    direction[[KINDS.index(kind), COUNT + KINDS.index(kind)]] = 1.0
    return direction


def test_the_reference_has_only_errors_that_are_observable():
    found = analyse(information(both("time_offset_s")), np.ones(2 * COUNT), 1)
    assert found.common == ("time_offset_s",)
    assert not found.hidden
    assert found.free.tolist() == [True] * 7 + [False]
    assert np.isfinite(found.covariance).all()
    assert found.covariance[7].tolist() == [0.0] * 8
    lacking = information(both("time_offset_s"), both("azimuth"))
    found = analyse(lacking, np.ones(2 * COUNT), 0)
    assert found.common == ("time_offset_s", "azimuth")
    assert not found.hidden
    assert np.flatnonzero(~found.free).tolist() == [2, 3]


def test_uncertain_biases_are_not_observable():
    alone = np.zeros(2 * COUNT)
    alone[COUNT + KINDS.index("range_gain")] = 1.0
    found = analyse(information(both("time_offset_s"), alone), np.ones(2 * COUNT), 0)
    assert found.common == ("time_offset_s",)
    assert found.hidden == (COUNT + 1,)
    weak = 0.5 * np.eye(2 * COUNT)
    found = analyse(weak, np.ones(2 * COUNT), 0)
    assert not found.free.any()
    assert len(found.hidden) + len(found.common) == 2 * COUNT
    assert analyse(weak, 10.0 * np.ones(2 * COUNT), 0).free.sum() == 2 * COUNT - 1
