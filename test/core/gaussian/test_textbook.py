"""A target alone: the engine is a textbook's filter and smoother."""

from functools import partial

import numpy as np
import pytest
import textbook
from lone import MEAN, STD, TWO_MOTIONS, lone, path, scan_at, started

from phd_jdtc_ros.core.gaussian.algebra import kalman
from phd_jdtc_ros.core.gaussian.smoothing.smoother import backward_pass
from phd_jdtc_ros.core.types import Detections, Scan

EVEN = 6.0 * np.arange(1, 15)
UNEVEN = np.cumsum([6.0, 0.4, 11.0, 6.0, 25.0, 3.0, 3.0, 1e-3, 60.0, 6.0, 5.0, 7.0])
LAG = 5
NONE_AT = 4  # The scan without a detection
OTHER = {
    "radar.position": [-4e3, 9e3],
    "radar.yaw_deg": -110.0,
    "radar.range_std": 90.0,
    "radar.azimuth_std_deg": 2.0,
    "radar.clutter_rate": 0.0,
    "radar.detection_probability": 0.999,
    "radar.max_range": 5e4,
}


@pytest.fixture
def all_iterations(monkeypatch):
    """Let every update take all its iterations, so that it can be compared to the last digit."""
    monkeypatch.setattr(kalman, "innovations", partial(kalman.innovations, converged=0.0))


def plots(config, seconds, time_s, turn_rate=0.0, seed=0):
    """Return (measurement, time) of one scan after the other."""
    (radar,) = config.model.radars
    rng = np.random.default_rng(seed)
    truth = path(seconds + time_s, turn_rate)
    noise = rng.standard_normal((len(truth), 2)) * radar.noise_std
    return radar.measure(truth) + noise


def run(engine, seconds, measured, time_s):
    """Return the filtered and the smoothed estimates of an engine."""
    filtered, smoothed = [], []
    for index, second in enumerate(seconds):
        given, since = measured[index], [time_s[index]]
        if index == NONE_AT:
            given, since = np.zeros((0, 2)), []
        step = engine.step(scan_at(second, given, time_s=np.array(since) if any(time_s) else None))
        filtered += step.filtered
        smoothed += step.smoothed
    return filtered, [*smoothed, *engine.flush()]


def close(found, expected, atol=0.0):
    """Compare an estimate with a distribution, entries of a covariance with its deviations."""
    (state,), (covariance,) = found.state, found.covariance
    std = np.sqrt(np.maximum(np.diag(expected.covariance), 1e-300))
    np.testing.assert_allclose(state, expected.mean, rtol=1e-9, atol=max(1e-9 * std.min(), atol))
    scale = std[:, None] * std
    np.testing.assert_allclose(covariance / scale, expected.covariance / scale, atol=1e-8 + atol)


def textbook_run(config, seconds, measured, time_s, iterations=textbook.ITERATIONS):
    """Return the filtered distributions of the only motion, and the smoothed ones."""
    (radar,), (motion,) = config.model.radars, config.model.modes.motions
    now = textbook.initial(motion, MEAN, STD)
    filtered, moves, previous = [], [], 0.0
    for index, second in enumerate(seconds):
        later, gain = textbook.predict(now, motion, second - previous)
        moves.append((later, gain))
        now, previous = later, second
        if index != NONE_AT:
            now, _ = textbook.update(
                now, radar, measured[index], time_s[index], iterations=iterations
            )
        filtered.append(now)
    smoothed = []
    for index in range(len(seconds)):
        last = min(index + LAG, len(seconds) - 1)
        later = filtered[last]
        for earlier in range(last - 1, index - 1, -1):
            later = textbook.smooth(filtered[earlier], *moves[earlier + 1], later)
        smoothed.append(later)
    return filtered, smoothed


@pytest.mark.parametrize("seconds", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("timed", [False, True], ids=["at the stamp", "at their own times"])
@pytest.mark.usefixtures("all_iterations")
def test_one_motion_is_the_kalman_filter_and_the_rauch_tung_striebel_smoother(seconds, timed):
    config = lone({"lag": LAG})
    time_s = np.linspace(-2.0, 1.5, len(seconds)) if timed else np.zeros(len(seconds))
    measured = plots(config, seconds, time_s)
    filtered, smoothed = run(started(config), seconds, measured, time_s)
    expected, expected_smoothed = textbook_run(config, seconds, measured, time_s)
    assert len(filtered) == len(smoothed) == len(seconds)
    for found, right in zip(filtered, expected, strict=True):
        close(found, right)
    for found, right in zip(smoothed, expected_smoothed, strict=True):
        close(found, right)
        assert found.weight == pytest.approx(1.0, abs=1e-12)
    assert [found.lag for found in smoothed] == [LAG] * (len(seconds) - LAG) + [4, 3, 2, 1, 0]


def test_updates_that_stop_early_are_as_near_to_the_most_probable_state_as_they_say():
    config = lone({"lag": LAG})
    (radar,) = config.model.radars
    measured = plots(config, EVEN, 0.0 * EVEN)
    filtered, smoothed = run(started(config), EVEN, measured, 0.0 * EVEN)
    expected, expected_smoothed = textbook_run(config, EVEN, measured, 0.0 * EVEN, iterations=50)
    for found, right in zip([*filtered, *smoothed], [*expected, *expected_smoothed], strict=True):
        np.testing.assert_allclose(
            found.position[0], right.mean[[0, 2]], atol=10.0 * 1e-2 * radar.range_std
        )


@pytest.mark.usefixtures("all_iterations")
def test_several_plots_of_radars_are_updates_one_after_the_other():
    given = {f"other.{name[6:]}": value for name, value in OTHER.items()}
    config = lone({"lag": LAG, "sensors": ["radar", "other"], **given})
    first, second = config.model.radars
    engine = started(config)
    truth = path(EVEN)
    (motion,) = config.model.modes.motions
    now = textbook.initial(motion, MEAN, STD)
    for index, seconds in enumerate(EVEN):
        reports = [radar.measure(truth[index : index + 1]) for radar in (first, second)]
        one, other = (Detections(report, None) for report in reports)
        given = (one, None) if index % 3 == 0 else (one, other)
        (found,) = engine.step(Scan(scan_at(seconds, []).stamp_ns, given)).filtered
        now, _ = textbook.predict(now, motion, 6.0)
        for radar, report, part in zip((first, second), reports, given, strict=True):
            if part is not None:
                now, _ = textbook.update(now, radar, report[0])
        close(found, now)


def expected_of(step_or_smoothed):
    probability, modes = step_or_smoothed
    return textbook.mixed(probability, modes)


@pytest.mark.parametrize("seconds", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("timed", [False, True], ids=["at the stamp", "at their own times"])
@pytest.mark.usefixtures("all_iterations")
def test_two_motions_are_interacting_multiple_models(seconds, timed):
    config = lone({"lag": LAG, **TWO_MOTIONS})
    (radar,), modes = config.model.radars, config.model.modes
    time_s = np.linspace(-2.0, 1.5, len(seconds)) if timed else np.zeros(len(seconds))
    measured = plots(config, seconds, time_s, turn_rate=0.02)
    filtered, smoothed = run(started(config), seconds, measured, time_s)

    parts = [textbook.initial(motion, MEAN, STD) for motion in modes.motions]
    steps, previous = [textbook.first_step([0.5, 0.5], parts)], 0.0
    for index, second in enumerate(seconds):
        dt = second - previous
        given = [] if index == NONE_AT else [(radar, measured[index], time_s[index])]
        steps.append(textbook.imm(steps[-1], modes.motions, modes.transition(dt), dt, given))
        previous = second
    del steps[0]
    assert 0.02 < steps[-1].probability[0] < 0.98  # Both modes matter
    for found, step in zip(filtered, steps, strict=True):
        close(found, expected_of((step.probability, step.modes)))
    for index, found in enumerate(smoothed):
        close(
            found, expected_of(textbook.imm_smoothed(steps[index : index + LAG + 1], modes.motions))
        )


@pytest.mark.usefixtures("all_iterations")
def test_mode_probabilities_of_the_filter_and_the_smoother_are_those_of_the_textbook():
    config = lone({"lag": 3, **TWO_MOTIONS})
    (radar,), modes = config.model.radars, config.model.modes
    engine = started(config)
    parts = [textbook.initial(motion, MEAN, STD) for motion in modes.motions]
    measured = plots(config, EVEN, 0.0 * EVEN, turn_rate=0.03)
    steps = [textbook.first_step([0.5, 0.5], parts)]
    for index, second in enumerate(EVEN[:4]):
        engine.step(scan_at(second, measured[index]))
        given = [(radar, measured[index], 0.0)]
        steps.append(textbook.imm(steps[-1], modes.motions, modes.transition(6.0), 6.0, given))
    backward = backward_pass(engine._window)
    for lag, mixture in enumerate(backward):
        probability, parts = textbook.imm_smoothed(steps[len(steps) - 1 - lag :], modes.motions)
        np.testing.assert_allclose(mixture.sums.mode_weight[0], probability, rtol=1e-9)
        for mode, part in enumerate(parts):
            mean = part.mean
            np.testing.assert_allclose(mixture.mean[0, mode], mean, rtol=1e-8, atol=1e-9)
    assert len(backward) == 3
