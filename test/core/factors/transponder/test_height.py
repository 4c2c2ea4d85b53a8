"""Heights and their filter, and the reprojection of plots of missing and false heights."""

import numpy as np
import pytest
from hard_turns import GIVEN, PERIOD_S, measured
from lone import lone, scan_at

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors.transponder import height, reprojection
from phd_jdtc_ros.core.factors.transponder.height import HeightModel, Heights
from phd_jdtc_ros.core.factors.transponder.history import History
from phd_jdtc_ros.core.sensors.point_gate import DETECTION_GATE_SIGMA
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections

# Almost no garbled heights and none given up: the belief stays Gaussian.
MODEL = HeightModel(std=8.0, noise_density=0.5, climb_std=12.0, garbled=1e-12, kept_s=1e15)
FIRST = np.zeros(1, dtype=np.int64)
ROW = np.array([[1.0, 0.0]])
RADAR = lone({"radar.fields.height": "height", "radar.range_std": 40.0}).model.radars[0]
# Four targets of five rows each; the height of the last one is not known, the second's not well.
TARGETS, ROWS = 4, 5
HEIGHTS = Heights(
    np.array([0.999, 0.9, 0.995, 0.4]),
    np.array([[9e3, 0.0], [3e3, 0.0], [5e3, 0.0], [4e3, 0.0]]),
    np.array([100.0, 400.0, 2500.0, 100.0])[:, None, None] * np.eye(2),
)
# Heights of plots: none, their targets' heights, and garbled ones.
MISSING, TRUE, GARBLED = range(0, 10), range(10, 16), range(16, 20)


def matrices(dt, model=MODEL):
    move = np.array([[1.0, dt], [0.0, 1.0]])
    noise = model.noise_density * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return move, noise


def textbook(times, measured, model=MODEL):
    """Return filtered and smoothed means and covariances at the times of the measurements."""
    mean = np.array([measured[0], 0.0])
    covariance = np.diag([model.std**2, model.climb_std**2])
    filtered, predicted = [(mean, covariance)], []
    for dt, value in zip(np.diff(times), measured[1:], strict=True):
        move, noise = matrices(dt, model)
        before = move @ mean, move @ covariance @ move.T + noise
        spread = ROW @ before[1] @ ROW.T + model.std**2
        gain = before[1] @ ROW.T / spread
        mean = before[0] + gain[:, 0] * (value - before[0][0])
        covariance = before[1] - gain @ ROW @ before[1]
        predicted.append(before)
        filtered.append((mean, covariance))
    smoothed = [filtered[-1]]
    for k in range(len(times) - 2, -1, -1):
        move, _ = matrices(times[k + 1] - times[k], model)
        gain = filtered[k][1] @ move.T @ np.linalg.inv(predicted[k][1])
        later, ahead = smoothed[0], predicted[k]
        smoothed.insert(
            0,
            (
                filtered[k][0] + gain @ (later[0] - ahead[0]),
                filtered[k][1] + gain @ (later[1] - ahead[1]) @ gain.T,
            ),
        )
    return filtered, smoothed


def updated(heights, value, since=0.0, model=MODEL):
    compared = height.compare(heights, FIRST, np.array([value]), np.array([since]), model)
    return height.update(compared, FIRST, np.ones(1), np.zeros(1))[0]


@pytest.fixture
def record():
    rng = np.random.default_rng(3)
    times = np.cumsum([0.0, 4.0, 4.0, 8.0, 4.0, 3.0])
    return times, 3000.0 + 6.0 * times + 8.0 * rng.standard_normal(len(times))


def test_filter_is_the_kalman_filter_and_history_smooths_as_rauch_tung_and_striebel(record):
    times, measured = record
    filtered, smoothed = textbook(times, measured)
    heights, history = Heights.fresh(1), History.empty()
    stamps = (1e9 * times).astype(np.int64) + 10**12
    for k, value in enumerate(measured):
        if k:
            heights = heights.predict(np.array([times[k] - times[k - 1]]), MODEL)
        heights = updated(heights, value)
        np.testing.assert_allclose(heights.mean[0], filtered[k][0], rtol=1e-6)
        np.testing.assert_allclose(heights.covariance[0], filtered[k][1], rtol=1e-4, atol=1e-6)
        history = history.record(np.array([7]), int(stamps[k]), heights)
    for k, stamp in enumerate(stamps.tolist()):
        found = history.smooth(np.array([7]), stamp, MODEL)
        np.testing.assert_allclose(found.mean[0], smoothed[k][0], rtol=1e-5)
        np.testing.assert_allclose(found.covariance[0], smoothed[k][1], rtol=1e-3, atol=1e-4)


def test_smoothed_height_between_two_scans_is_that_of_a_step_of_its_own(record):
    times, measured = record
    # A measurement without information, at 10 s, adds that time to the textbook's.
    filtered, _ = textbook(times, measured)
    between = 10.0
    before = int(np.searchsorted(times, between)) - 1
    move, noise = matrices(between - times[before])
    start = move @ filtered[before][0], move @ filtered[before][1] @ move.T + noise
    move, noise = matrices(times[before + 1] - between)
    ahead = move @ start[0], move @ start[1] @ move.T + noise
    _, smoothed = textbook(times, measured)
    later = smoothed[before + 1]
    gain = start[1] @ move.T @ np.linalg.inv(ahead[1])
    expected = start[0] + gain @ (later[0] - ahead[0])
    history, heights = History.empty(), Heights.fresh(2)
    for k, (mean, covariance) in enumerate(filtered):
        heights = Heights(np.ones(1), mean[None], covariance[None])
        history = history.record(np.array([7]), int(times[k] * 1e9), heights)
        other = Heights(np.ones(1), mean[None] + np.array([500.0, 0.0]), covariance[None])
        history = history.record(np.array([3]), int(times[k] * 1e9), other)
    found = history.smooth(np.array([7, 3, 5]), int(between * 1e9), MODEL)
    np.testing.assert_allclose(found.mean[0], expected, rtol=1e-9)
    np.testing.assert_allclose(found.mean[1], expected + np.array([500.0, 0.0]), rtol=1e-9)
    assert found.known.tolist() == [1.0, 1.0, 0.0]


def test_history_keeps_what_a_stamp_needs():
    history, one = History.empty(), Heights(np.ones(1), np.ones((1, 2)), np.eye(2)[None])
    for stamp in (10, 20, 30, 40):
        history = history.record(np.array([7]), stamp, one)
    history = history.record(np.array([8]), 10, one).record(np.array([9]), 40, one)
    kept = history.since(25, np.array([7, 8]))
    assert list(zip(kept.label.tolist(), kept.stamp_ns.tolist(), strict=True)) == [
        *((7, 20), (7, 30), (7, 40)),
        (8, 10),
    ]


def test_height_of_a_detection_is_at_its_own_time():
    heights = Heights(np.ones(1), np.array([[1000.0, 10.0]]), np.diag([25.0, 4.0])[None])
    found = updated(heights, 1020.0, since=2.0)
    np.testing.assert_allclose(found.mean[0], [1000.0, 10.0])
    row = np.array([1.0, 2.0])
    cov = heights.covariance[0]
    spread = row @ cov @ row + MODEL.std**2
    expected = cov - np.outer(cov @ row, row @ cov) / spread
    np.testing.assert_allclose(found.covariance[0], expected, rtol=1e-6)


def test_soft_association_matches_the_mixture_of_what_may_be_so():
    heights = Heights(np.ones(1), np.array([[1000.0, 0.0]]), np.diag([100.0, 4.0])[None])
    target, values = np.zeros(2, dtype=np.int64), np.array([1010.0, 980.0])
    own, none = np.array([0.5, 0.2]), np.array([0.3])
    compared = height.compare(heights, target, values, np.zeros(2), MODEL)
    found, again = height.update(compared, target, own, none)
    assert not again.any()
    gain = np.array([100.0, 0.0]) / (100.0 + MODEL.std**2)
    each = [heights.mean[0], *(heights.mean[0] + gain * (value - 1000.0) for value in values)]
    share = np.array([0.3, 0.5, 0.2])
    mean = share @ np.array(each)
    np.testing.assert_allclose(found.mean[0], mean, rtol=1e-9)
    after = heights.covariance[0] - np.outer(gain, [100.0, 0.0])
    covariance = 0.3 * heights.covariance[0] + 0.7 * after
    covariance += sum(s * np.outer(m - mean, m - mean) for s, m in zip(share, each, strict=True))
    np.testing.assert_allclose(found.covariance[0], covariance, rtol=1e-9)


def test_garbled_height_moves_no_target_and_costs_its_probability():
    model = HeightModel(garbled=0.01)
    heights = Heights(np.ones(1), np.array([[3000.0, 0.0]]), np.diag([30.0, 1.0])[None])
    compared = height.compare(heights, FIRST, np.array([9000.0]), np.zeros(1), model)
    assert np.exp(compared.log_factor[0]) == pytest.approx(0.01)
    found, _ = height.update(compared, FIRST, np.ones(1), np.zeros(1))
    np.testing.assert_allclose(found.mean, heights.mean)
    np.testing.assert_allclose(found.covariance, heights.covariance)
    model = HeightModel()
    heights = Heights(np.full(1, 0.995), np.array([[3000.0, 0.0]]), np.diag([30.0, 1.0])[None])
    compared = height.compare(heights, FIRST, np.array([9000.0]), np.zeros(1), model)
    found, again = height.update(compared, FIRST, np.ones(1), np.zeros(1))
    np.testing.assert_allclose(found.mean, heights.mean)
    assert not again.any()
    assert found.known[0] == pytest.approx(0.67, abs=0.01)


def test_target_whose_height_began_wrong_finds_the_right_one():
    model = HeightModel()
    heights = updated(Heights.fresh(1), 12e3, model=model)
    for _ in range(6):
        heights = updated(heights.predict(np.array([4.0]), model), 3048.0, model=model)
    assert heights.known[0] > 0.9
    assert heights.mean[0, 0] == pytest.approx(3048.0, abs=10.0)


def test_unknown_height_has_no_likelihood_and_no_effect():
    heights = Heights(np.full(1, 0.8), np.array([[3000.0, 2.0]]), np.diag([30.0, 1.0])[None])
    compared = height.compare(heights, FIRST, np.array([np.nan]), np.zeros(1), HeightModel())
    found, _ = height.update(compared, FIRST, np.ones(1), np.zeros(1))
    assert compared.log_factor[0] == 0.0
    for one, other in zip(found, heights, strict=True):
        np.testing.assert_allclose(one, other)


@pytest.mark.parametrize("level", [-304.8, 3048.0])
def test_both_engines_publish_filtered_and_smoothed_heights(level):
    given = {
        "interval_s": 4.0,
        "lag": 3,
        "births": [],
        "detection_births.rates": [0.05],
        "detection_births.std": [100.0, 2e-3],
        "radar.fields.height": "height",
        "radar.detection_probability": 0.95,
        "radar.clutter_rate": 1.0,
    }
    config = lone(given)
    tracker, radar = new_engine(config), config.model.radars[0]
    measured, published, smoothed = [], [], []
    rng = np.random.default_rng(5)
    for k in range(12):
        state = np.array([[8e3 + 480.0 * k, 120.0, 9e3, 0.0, 0.0]])
        value = 30.48 * np.round((level + 24.0 * k) / 30.48)
        noisy = radar.measure(state) + rng.standard_normal((1, 2)) * radar.noise_std
        measured.append(value)
        step = tracker.step(scan_at(4.0 * k + 4.0, noisy, height=np.array([value])))
        published += step.filtered
        smoothed += step.smoothed
    smoothed += tracker.flush()
    filtered, hindsight = textbook(4.0 * np.arange(12), measured, HeightModel())
    for k in range(5, 12):
        known = published[k].attributes
        np.testing.assert_allclose(known.height[0], filtered[k][0], atol=1.0)
        np.testing.assert_allclose(known.height_covariance[0], filtered[k][1], rtol=0.1, atol=1.0)
    # The others are smoothed with fewer scans than the last one.
    for k in range(8, 12):
        known = smoothed[k].attributes
        np.testing.assert_allclose(known.height[0], hindsight[k][0], atol=1.0)
        np.testing.assert_allclose(known.height_covariance[0], hindsight[k][1], rtol=0.1, atol=1.0)


def crowd(rng):
    """Return rows near each other as the radar would measure them, their targets, and plots."""
    target = np.arange(TARGETS).repeat(ROWS)
    expected = np.stack([15e3 + rng.normal(0.0, 400.0, 20), rng.normal(0.0, 0.03, 20)], axis=1)
    of = np.concatenate([np.arange(0, 20, 2), np.arange(1, 20, 2)])
    seen, height = expected[of], HEIGHTS.mean[target[of], 0]
    height[MISSING], height[GARBLED] = np.nan, 6900.0
    slant = np.hypot(seen[:, 0], HEIGHTS.mean[target[of], 0])
    seen[:, 0] = np.sqrt(slant**2 - np.nan_to_num(height) ** 2)
    return expected, target, Detections(seen, None, height=height)


def explained(expected, target, detections, column):
    """Return whether a plot has the known height of a target that it is near to."""
    error = (detections.measurement[column] - expected) / RADAR.noise_std
    near = (error**2).sum(axis=1) <= DETECTION_GATE_SIGMA**2
    same = np.abs(detections.height[column] - HEIGHTS.mean[target, 0]) < 1000.0
    return (near & same & (HEIGHTS.known[target] > 0.5)).any()


def by_hand(expected, target, detections):
    """Return the log likelihood of each pair, of a plot read at its row's target's height."""
    found = np.full((len(expected), len(detections)), -np.inf)
    for row, column in np.ndindex(found.shape):
        distance, azimuth = detections.measurement[column]
        std, own, said = RADAR.noise_std.copy(), target[row], detections.height[column]
        height, off = HEIGHTS.mean[own, 0], np.sqrt(HEIGHTS.covariance[own, 0, 0])
        false = not (abs(said - height) < 1000.0 or explained(expected, target, detections, column))
        # Another height contradicts an uncertain one.
        if HEIGHTS.known[own] > (0.5 if np.isnan(said) else 0.99) and false:
            square = distance**2 + np.nan_to_num(said) ** 2
            ground, lower = (np.sqrt(square - above**2) for above in (height, height + off))
            std[0] = np.hypot(std[0], ground - lower)
            distance = ground
        error = (np.array([distance, azimuth]) - expected[row]) / std
        if (error**2).sum() <= DETECTION_GATE_SIGMA**2:
            found[row, column] = -0.5 * (error**2).sum() - np.log(2.0 * np.pi * std.prod())
    return found


def test_a_plot_of_a_false_height_is_read_at_the_height_of_each_target():
    expected, target, detections = crowd(np.random.default_rng(1))
    pairs = reprojection.pair(
        lambda seen: RADAR.gated_pairs(expected, seen),
        *(target, HEIGHTS, View.of(RADAR, detections), RADAR.height_projection, HeightModel()),
    )
    found = np.full((len(expected), len(detections)), -np.inf)
    found[pairs.row, pairs.column] = pairs.log_likelihood
    wanted = by_hand(expected, target, detections)
    assert all(np.isfinite(wanted[:, of]).sum() >= 6 for of in (MISSING, TRUE, GARBLED))
    assert len(pairs.row) == np.isfinite(wanted).sum()
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_a_track_stays_where_its_target_is_without_its_height_and_with_a_false_one():
    # At 30 km and a height of 9 km the plots without it, and with 2 km, are 1.3 km farther away.
    reported = {**dict.fromkeys(range(12, 17), np.nan), 20: 2e3}
    one = new_engine(lone({**GIVEN, "radar.fields.height": "height"}))
    rng, numbers = np.random.default_rng(2), set()
    noise = np.array([5.0, np.radians(0.01)])
    for index in range(24):
        position = np.array([[3e4 - 100.0 * index, 150.0 * PERIOD_S * index - 6e3]])
        plot, height = measured(position, noise, rng), reported.get(index, 9e3)
        plot[:, 0] = np.sqrt(plot[:, 0] ** 2 + 9e3**2 - np.nan_to_num(height) ** 2)
        step = one.step(scan_at((index + 1) * PERIOD_S, plot, height=np.array([height])))
        for found in step.filtered:
            numbers.update(found.track_id.tolist())
            if index > 4:
                apart = np.hypot(*(found.position - position).T)
                assert apart.shape == (1,), index
                assert apart[0] < 100.0, index
    assert len(numbers) == 1
