"""Associations: the engine against the sum over all that could have happened."""

from functools import partial

import numpy as np
import pytest
import textbook
from lone import (
    MEAN,
    START_NS,
    STD,
    TWO_MOTIONS,
    UNREDUCED,
    lone,
    mixture_of,
    path,
    scan_at,
    start_from,
    started,
)

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.algebra import kalman
from phd_jdtc_ros.core.gaussian.extraction import extract
from phd_jdtc_ros.core.gaussian.measurement import likely_pairs

DETECTION = 0.8
SURVIVAL = 0.9
CLUTTER = {
    "radar.detection_probability": DETECTION,
    "radar.clutter_rate": 3.0,
    "radar.clutter_max_range": 2e4,
}


def configuration(given=None):
    return lone({**CLUTTER, **UNREDUCED, **(given or {})})


def clutter_density(radar):
    return radar.clutter_rate / (2.0 * np.pi * radar.visibility.clutter_range)


@pytest.fixture(autouse=True)
def _nothing_left_out(monkeypatch):
    """Let every update take all its iterations, and look at all pairs within the gates."""
    monkeypatch.setattr(likely_pairs, "LEAST_SHARE", 1e-12)
    monkeypatch.setattr(kalman, "innovations", partial(kalman.innovations, converged=0.0))


def near(radar, mean, rng, count=1, spread=1.0):
    """Return detections about a state."""
    about = radar.measure(np.asarray(mean)[None])
    return about + spread * rng.standard_normal((count, 2)) * radar.noise_std


def histories(config, seconds, scans, existence):
    """Return all that can have happened to one target that exists at first.

    Each is a list of its distributions, one per scan until its death; with its probability, and
    with the moves between them, for the backward step. With several motions, each change of the
    motion is another history.
    """
    (radar,), modes = config.model.radars, config.model.modes
    alive = []
    for motion in modes.motions:
        first = textbook.initial(motion, MEAN, STD)
        alive.append((existence / len(modes), [first], []))
    last = list(range(len(modes)))
    never = (1.0 - existence) * np.prod([clutter_density(radar) ** len(m) for m in scans])
    ended = [(never, [], [])]
    previous = 0.0
    for second, measurement in zip(seconds, scans, strict=True):
        dt, previous = second - previous, second
        survival = float(modes.survival(dt)[0])
        rest = clutter_density(radar) ** len(measurement)
        later_scans = scans[list(seconds).index(second) :]
        silent = np.prod([clutter_density(radar) ** len(m) for m in later_scans])
        following, followed_by = [], []
        for (probability, states, moves), mode in zip(alive, last, strict=True):
            ended.append((probability * (1.0 - survival) * silent, states, moves))
            for to, motion in enumerate(modes.motions):
                later, gain = textbook.predict(states[-1], motion, dt)
                p = probability * survival * modes.transition(dt)[mode, to]
                following.append(
                    (p * (1.0 - DETECTION) * rest, [*states, later], [*moves, (later, gain)])
                )
                for measured in measurement:
                    posterior, log_likelihood = textbook.update(later, radar, measured)
                    explained = p * DETECTION * np.exp(log_likelihood)
                    explained *= rest / clutter_density(radar)
                    following.append((explained, [*states, posterior], [*moves, (later, gain)]))
                followed_by += [to] * (1 + len(measurement))
        alive, last = following, followed_by
    every = [*ended, *alive]
    total = sum(probability for probability, *_ in every)
    return [(probability / total, states, moves) for probability, states, moves in every]


def at_scan(every, index):
    """Return the existence probability and the distribution at a scan, 0 being the start."""
    parts, shares = [], []
    for probability, states, moves in every:
        if len(states) <= index:
            continue
        smoothed = states[-1]
        for earlier in range(len(states) - 2, index - 1, -1):
            smoothed = textbook.smooth(states[earlier], *moves[earlier], smoothed)
        parts.append(smoothed)
        shares.append(probability)
    existence = sum(shares)
    return existence, textbook.mixed(np.array(shares) / existence, parts)


def measured_scans(radar, seconds, rng, empty=()):
    """Return detections near the target, and none in some scans."""
    found = []
    for index, state in enumerate(path(np.asarray(seconds))):
        count = 0 if index in empty else rng.integers(1, 3)
        found.append(near(radar, state, rng, count, spread=1.5))
    return found


@pytest.mark.parametrize(
    ("empty", "existence"), [((), 0.6), ((1,), 0.9), ((2, 3), 0.95), ((0, 1, 2, 3), 0.7)]
)
@pytest.mark.parametrize("survival", [1.0, SURVIVAL])
def test_one_target_is_the_sum_over_all_its_histories(empty, existence, survival):
    rng = np.random.default_rng(len(empty))
    config = configuration(
        {
            "target.survival_probability": survival,
            "lag": 4,
            "existence": [1e-9, 1e-9],
        }
    )
    (radar,) = config.model.radars
    seconds = [6.0, 12.0, 21.0, 24.0]
    scans = measured_scans(radar, seconds, rng, empty)
    engine = started(config, (existence, MEAN, STD))
    for index, each in enumerate(zip(seconds, scans, strict=True)):
        engine.step(scan_at(*each))
        # The whole density: that of an unseen target is reported by its most probable part.
        (rows,), forward = engine.forward.unswept, engine.forward
        found = extract(rows.stored, forward.dynamics, forward.stamp_ns, 0, 0.0)
        enumerated = histories(config, seconds[: index + 1], scans[: index + 1], existence)
        check(found, *at_scan(enumerated, index + 1))
    every = histories(config, seconds, scans, existence)
    smoothed = engine.flush()
    assert len(smoothed) == 4
    for index, found in enumerate(smoothed):
        check(found, *at_scan(every, index + 1))


@pytest.mark.parametrize("empty", [(), (1,)])
def test_target_whose_motions_go_on_apart_is_the_sum_over_all_their_changes(empty):
    rng = np.random.default_rng(7)
    given = {
        "lag": 3,
        "bounds.least_mode": 0.0,
        "existence": [1e-9, 1e-9],
    }
    config = configuration({**TWO_MOTIONS, **given})
    (radar,) = config.model.radars
    seconds = [6.0, 12.0, 21.0]
    scans = measured_scans(radar, seconds, rng, empty)
    engine = new_engine(config)
    both = mixture_of(engine.forward.dynamics, [(0.8, MEAN, STD)]).take(np.array([0, 0]))
    apart = both.changed(weight=both.weight * np.eye(2)[:, :, None])
    start_from(engine, START_NS, apart)
    filtered = [
        engine.step(scan_at(*each)).filtered[0] for each in zip(seconds, scans, strict=True)
    ]
    for index, found in enumerate(filtered):
        enumerated = histories(config, seconds[: index + 1], scans[: index + 1], 0.8)
        check(found, *at_scan(enumerated, index + 1))
    every = histories(config, seconds, scans, 0.8)
    for index, found in enumerate(engine.flush()):
        check(found, *at_scan(every, index + 1))


def check(found, existence, expected):
    assert found.weight[0] == pytest.approx(existence, rel=1e-5)
    std = np.sqrt(np.diag(expected.covariance))
    near_enough = 1e-5 * np.where(std > 0.0, std, 1.0)
    np.testing.assert_array_less(np.abs(found.state[0] - expected.mean), near_enough + 1e-12)
    scale = np.where(std > 0.0, std, 1.0)
    np.testing.assert_allclose(
        found.covariance[0] / scale / scale[:, None],
        expected.covariance / scale / scale[:, None],
        atol=1e-4,
    )


def test_target_that_no_radar_sees_any_more_fades_as_bayes_says():
    config = configuration(
        {
            "target.survival_probability": SURVIVAL,
            "existence": [1e-9, 1e-9],
        }
    )
    engine = started(config, (0.8, MEAN, STD))
    existence = 0.8
    for index in range(1, 9):
        (found,) = engine.step(scan_at(6.0 * index, [])).filtered
        existence *= SURVIVAL
        existence = existence * (1.0 - DETECTION) / (1.0 - existence * DETECTION)
        if existence < config.values["detection_births.least_probability"]:
            assert len(found) == 0
            return
        assert found.weight[0] == pytest.approx(existence, rel=1e-9)
    raise AssertionError("the target is never dropped")


def test_certain_target_that_is_missed_for_long_still_exists():
    config = configuration({"radar.detection_probability": 0.999})
    engine = started(config)
    for index in range(1, 12):
        (found,) = engine.step(scan_at(6.0 * index, [])).filtered
        assert found.weight[0] == pytest.approx(1.0, abs=1e-9)
