"""Associations: the engine against the sum over all that could have happened."""

import itertools
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
    started,
)

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.algebra import kalman
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.measurement import pairs
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.sensors.report import Report
from phd_jdtc_ros.core.window.update import update

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
    return radar.clutter_rate / (2.0 * np.pi * radar.clutter_max_range)


@pytest.fixture(autouse=True)
def _nothing_left_out(monkeypatch):
    """Let every update take all its iterations, and look at all pairs within the gates."""
    monkeypatch.setattr(pairs, "LEAST_SHARE", 1e-12)
    monkeypatch.setattr(kalman, "innovations", partial(kalman.innovations, converged=0.0))


def near(radar, mean, rng, count=1, spread=1.0):
    """Return detections about a state."""
    about = radar.measure(np.asarray(mean)[None])
    return about + spread * rng.standard_normal((count, 2)) * radar.noise_std


def hypotheses(dynamics, rng):
    """Return three targets next to each other, with one, two and three hypotheses."""
    single = mixture_of(dynamics, [(1.0, MEAN, STD)])
    row_label = np.array([5, 7, 7, 9, 9, 9])
    weight = np.array([0.9, 0.3, 0.25, 0.2, 0.1, 0.65])
    mean = MEAN + rng.normal(0.0, [200.0, 10.0, 200.0, 10.0, 0.0], (6, 5))
    size = rng.uniform(0.3, 1.0, 6)
    return Mixture(
        row_label,
        weight[:, None, None],
        mean[:, None],
        size[:, None, None, None] * single.covariance,
        dynamics.unknown_snr(6),
    )


def enumerated(mixture, radar, measurement):
    """Return the weight of every hypothesis without a detection and with each of them.

    Every target exists or not, and has one of the detections or none; no two have the same one.
    """
    rows, count = len(mixture), len(measurement)
    evidence = np.zeros((rows, count))
    for row, column in itertools.product(range(rows), range(count)):
        prior = textbook.Normal(mixture.mean[row, 0], mixture.covariance[row, 0])
        _, log_likelihood = textbook.update(prior, radar, measurement[column])
        evidence[row, column] = np.exp(log_likelihood)
    weight = mixture.mass
    events = [
        # (the row or None if it does not exist, its detection or None, its factor)
        [
            (None, None, 1.0 - weight[mixture.row_label == row_label].sum()),
            *(
                (row, None, weight[row] * (1.0 - DETECTION))
                for row in np.flatnonzero(mixture.row_label == row_label)
            ),
            *(
                (row, column, weight[row] * DETECTION * evidence[row, column])
                for row in np.flatnonzero(mixture.row_label == row_label)
                for column in range(count)
            ),
        ]
        for row_label in np.unique(mixture.row_label)
    ]
    total, posterior = 0.0, np.zeros((rows, count + 1))
    for joint in itertools.product(*events):
        taken = [column for _, column, _ in joint if column is not None]
        if len(set(taken)) < len(taken):
            continue
        probability = np.prod([factor for *_, factor in joint])
        probability *= clutter_density(radar) ** (count - len(taken))
        total += probability
        for row, column, _ in joint:
            if row is not None:
                posterior[row, count if column is None else column] += probability
    return posterior / total


@pytest.mark.parametrize("count", [0, 1, 2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_weights_of_all_hypotheses_are_those_of_all_association_events(count, seed):
    rng = np.random.default_rng(seed)
    config = configuration()
    (radar,), dynamics = config.model.radars, Dynamics(config.model)
    mixture = hypotheses(dynamics, rng)
    measurement = near(radar, MEAN, rng, count)
    expected = enumerated(mixture, radar, measurement)
    scan, bounds = scan_at(6.0, measurement), new_engine(config).forward.bounds
    predicted = Branched(mixture, np.arange(len(mixture)))
    report, steps = Report(radar, scan.detections[0]), GaussianSteps(dynamics, bounds)
    updated = update(predicted, report, steps, 6.0)
    assert updated.newborns == ()
    assert updated.approximate == 0
    branched = updated.rows
    found = np.zeros_like(expected)
    for row in range(len(branched.mixture)):
        parent = branched.parent[row]
        means = [mixture.mean[parent, 0]] * (count + 1)
        prior = textbook.Normal(means[0], mixture.covariance[parent, 0])
        means[:count] = [textbook.update(prior, radar, told)[0].mean for told in measurement]
        own = branched.mixture.mean[row, 0]
        (column,) = [k for k, mean in enumerate(means) if np.allclose(own, mean, rtol=1e-9)]
        found[parent, column] = branched.mixture.mass[row]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6)
    assert not count or expected[:, :count].sum() > 0.3


def histories(config, seconds, scans, existence):
    """Return all that can have happened to one target that exists at first.

    Each is a list of its distributions, one per scan until its death; with its probability, and
    with the moves between them, for the backward step. With several motions, each change of the
    motion is another history.
    """
    (radar,), modes = config.model.radars, config.model.modes
    alive = []
    for motion in modes.motions:
        own = np.isin(np.arange(5), motion.support)
        first = textbook.Normal(np.where(own, MEAN, 0.0), np.diag(np.where(own, STD, 0.0) ** 2))
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
                    told, log_likelihood = textbook.update(later, radar, measured)
                    explained = p * DETECTION * np.exp(log_likelihood)
                    explained *= rest / clutter_density(radar)
                    following.append((explained, [*states, told], [*moves, (later, gain)]))
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
        told = states[-1]
        for earlier in range(len(states) - 2, index - 1, -1):
            told = textbook.smooth(states[earlier], *moves[earlier], told)
        parts.append(told)
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
            "confirm_probability": 1e-9,
            "delete_probability": 1e-9,
        }
    )
    (radar,) = config.model.radars
    seconds = [6.0, 12.0, 21.0, 24.0]
    scans = measured_scans(radar, seconds, rng, empty)
    engine = started(config, (existence, MEAN, STD))
    filtered = [
        engine.step(scan_at(*told)).filtered[0] for told in zip(seconds, scans, strict=True)
    ]
    for index, found in enumerate(filtered):
        told = histories(config, seconds[: index + 1], scans[: index + 1], existence)
        check(found, *at_scan(told, index + 1))
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
        "confirm_probability": 1e-9,
        "delete_probability": 1e-9,
    }
    config = configuration({**TWO_MOTIONS, **given})
    (radar,) = config.model.radars
    seconds = [6.0, 12.0, 21.0]
    scans = measured_scans(radar, seconds, rng, empty)
    engine = new_engine(config)
    both = mixture_of(engine.forward.dynamics, [(0.8, MEAN, STD)]).take(np.array([0, 0]))
    apart = both.changed(weight=both.weight * np.eye(2)[:, :, None])
    engine.forward.start_from(START_NS, apart)
    filtered = [
        engine.step(scan_at(*told)).filtered[0] for told in zip(seconds, scans, strict=True)
    ]
    for index, found in enumerate(filtered):
        told = histories(config, seconds[: index + 1], scans[: index + 1], 0.8)
        check(found, *at_scan(told, index + 1))
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
            "confirm_probability": 1e-9,
            "delete_probability": 1e-9,
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
