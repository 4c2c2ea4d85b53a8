"""Input that a radar should not send: estimates stay finite, and their covariances positive."""

import numpy as np
import pytest
from lone import MEAN, START_NS, STD, TWO_MOTIONS, lone, path, scan_at, started
from runs import stepped

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.types import Detections, Scan

CLUTTER = {
    "existence": [1e-9, 1e-9],
    "lag": 3,
    "radar.detection_probability": 0.9,
    "radar.clutter_rate": 3.0,
    "radar.clutter_max_range": 2e4,
    "target.survival_probability": 0.99,
    "detection_births.rates": [0.1],
    **TWO_MOTIONS,
}
PLACE = np.array([500.0, -300.0])  # Of the radar


def sound(found):
    """Check that estimates are finite and that no covariance has a negative eigenvalue."""
    for part in ("state", "covariance", "weight", "class_probability"):
        assert np.isfinite(getattr(found, part)).all(), part
    np.testing.assert_array_equal(found.covariance, found.covariance.swapaxes(1, 2))
    variance = np.diagonal(found.covariance, axis1=1, axis2=2)
    assert (variance[:, :4] > 0.0).all()
    scale = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    correlation = found.covariance / scale[:, :, None] / scale[:, None, :]
    used = variance > 0.0
    correlation += np.eye(5) * ~used[:, None]
    assert np.linalg.eigvalsh(correlation).min(initial=1.0) > -1e-12
    assert (found.weight >= 0.0).all()
    assert (found.weight <= 1.0 + 1e-9).all()


def track(engine, scans):
    """Step through scans and check all estimates; return the filtered ones."""
    filtered = []
    with np.errstate(invalid="raise", over="raise", divide="raise"):
        for scan in scans:
            step = engine.step(scan)
            filtered += step.filtered
            for found in (*step.filtered, *step.smoothed):
                sound(found)
            assert np.isfinite(list(step.figures.values())).all()
        for found in engine.flush():
            sound(found)
    return filtered


def scans_along(radar, seconds, rng, turn_rate=0.0):
    """Return the detections of a target on its path, with one false one each."""
    for second, state in zip(seconds, path(np.asarray(seconds), turn_rate), strict=True):
        seen = radar.measure(state[None]) + rng.standard_normal((1, 2)) * radar.noise_std
        false = np.column_stack([rng.uniform(0.0, 2e4, 1), rng.uniform(-np.pi, np.pi, 1)])
        yield scan_at(second, np.concatenate([seen, false]))


@pytest.mark.parametrize("least_mode", [0.05, 1.0])
@pytest.mark.parametrize("azimuth_std", [1e-9, 1.0])
@pytest.mark.parametrize("range_std", [1e-9, 300.0])
def test_least_noise_that_the_configuration_allows(range_std, azimuth_std, least_mode):
    config = lone(
        {
            **CLUTTER,
            "bounds.least_mode": least_mode,
            "radar.range_std": range_std,
            "radar.azimuth_std_deg": azimuth_std,
            "cv.noise_density": 1e-9,
            "ct.noise_density": 1e-9,
            "ct.turn_noise_density": 1e-15,
        }
    )
    rng = np.random.default_rng(0)
    track(started(config), scans_along(config.model.radars[0], 6.0 * np.arange(1, 12), rng))


@pytest.mark.parametrize(
    ("seconds", "given"),
    [
        (1e-3 * np.arange(1, 30), {"cv.noise_density": 1e-9, "ct.noise_density": 1e-9}),
        (1e-3 * np.arange(1, 30), {"cv.noise_density": 1.0, "ct.noise_density": 1.0}),
        (
            np.cumsum([1e-9, 1e-9, 6.0, 3600.0, 1e-9, 6.0, 7200.0, 3600.0, 6.0, 6.0]),
            {"max_gap_scans": 1e6},
        ),
    ],
)
def test_intervals_of_a_nanosecond_a_millisecond_and_of_hours(seconds, given):
    config = lone({**CLUTTER, **given})
    scans = scans_along(config.model.radars[0], seconds, np.random.default_rng(1))
    track(started(config), scans)


def test_gap_of_an_hour_leaves_a_target_that_can_be_found_again():
    config = lone({**CLUTTER, "target.survival_probability": 1.0})
    (radar,) = config.model.radars
    engine, rng = started(config), np.random.default_rng(3)
    before, _ = stepped(engine, scans_along(radar, 6.0 * np.arange(1, 8), rng))
    state = before[-1].state[:1]
    again = radar.measure(state)
    (found,) = engine.step(scan_at(42.0 + 3600.0, again)).filtered
    sound(found)
    assert len(found) > 0
    for found in engine.flush():
        sound(found)


@pytest.mark.parametrize(
    "std", [[1e-6] * 5, [1.0, 1.0, 1.0, 1.0, 1e-3], [300.0, 30.0, 300.0, 30.0, 1e-3]]
)
def test_target_at_the_radar(std):
    config = lone(CLUTTER)
    state = np.array([PLACE[0], 0.0, PLACE[1], 0.0, 0.0])
    rng = np.random.default_rng(4)
    scans = []
    for second in 6.0 * np.arange(1, 10):
        about = np.abs(rng.normal(0.0, 300.0, 2))
        measured = np.column_stack([about, rng.uniform(-np.pi, np.pi, 2)])
        scans.append(scan_at(second, measured))
    track(started(config, (0.9, state, std)), scans)


def test_target_that_flies_over_the_radar():
    config = lone({**CLUTTER, "radar.detection_probability": 0.95})
    (radar,) = config.model.radars
    engine, rng = (
        started(config, (0.99, [-9500.0, 100.0, -300.0, 0.0, 0.0], STD)),
        np.random.default_rng(5),
    )
    scans = []
    for second in 6.0 * np.arange(1, 34):
        state = np.array([[-9500.0 + 100.0 * second, 100.0, -300.0, 0.0, 0.0]])
        measured = radar.measure(state) + rng.standard_normal((1, 2)) * radar.noise_std
        measured[:, 0] = np.abs(measured[:, 0])
        scans.append(scan_at(second, measured))
    filtered = track(engine, scans)
    # On the other side it is still one track, and near its place.
    last = filtered[-1]
    truth = np.array([-9500.0 + 100.0 * 198.0, -300.0])
    assert np.hypot(*(last.position - truth).T).min() < 600.0


# Reports by a radar and what it would measure.
REPORTS = {
    "range zero and the largest": lambda radar, _: Detections(
        np.array(
            [
                *([0.0, 0.0], [0.0, np.pi], [1e-300, 1.0]),
                *([radar.max_range, -np.pi], [radar.max_range, 2.0]),
            ]
        ),
        None,
    ),
    "equal detections": lambda _, true: Detections(np.repeat(true, 40, axis=0), None),
    **{
        f"noise {std}": lambda _, true, std=std: Detections(true, None, noise_std=np.array([std]))
        for std in ([1e-9, 1e-12], [1e7, 10.0], [np.nan, 0.01])
    },
    **{
        f"time {time_s}": lambda _, true, time_s=time_s: Detections(true, None, np.array([time_s]))
        for time_s in (-1e3, 1e3, 1e-12)
    },
}


@pytest.mark.parametrize("made", REPORTS.values(), ids=REPORTS)
def test_reports_of_extreme_numbers(made):
    config = lone(CLUTTER)
    (radar,) = config.model.radars
    scans = [
        Scan(START_NS + round(second * 1e9), (made(radar, radar.measure(path([second]))),))
        for second in 6.0 * np.arange(1, 8)
    ]
    track(started(config), scans)


@pytest.mark.parametrize("given", [{}, {"amplitude": "memory", "radar.detection_probability": 0.0}])
def test_scan_of_a_hundred_thousand_false_detections(given):
    config = lone({**CLUTTER, **given, "radar.clutter_rate": 1e5})
    (radar,) = config.model.radars
    rng = np.random.default_rng(6)
    scans = []
    for second, state in zip(6.0 * np.arange(1, 5), path(6.0 * np.arange(1, 5)), strict=True):
        count = 100_000 if second == 12.0 else 5
        false = np.column_stack([rng.uniform(0.0, 2e4, count), rng.uniform(-np.pi, np.pi, count)])
        measured = np.concatenate([radar.measure(state[None]), false])
        amplitude = radar.threshold + rng.exponential(1.0, len(measured))
        scans.append(scan_at(second, measured, amplitude))
    track(started(config), scans)


def test_many_equal_targets():
    config = lone(CLUTTER)
    (radar,) = config.model.radars
    engine = started(config, *[(0.5, MEAN, STD)] * 25)
    scans = [scan_at(second, radar.measure(path([second]))) for second in 6.0 * np.arange(1, 6)]
    filtered = track(engine, scans)
    assert filtered[-1].weight.sum() < 3.0


def test_no_targets_and_no_detections_are_no_fault():
    config = lone(CLUTTER)
    engine = started(config)
    scans = [scan_at(6.0 * k, []) for k in range(1, 5)]
    with pytest.raises(ValueError, match="no sensor reported"):
        engine.step(Scan(START_NS + 6_000_000_000, (None,)))
    track(engine, scans)
    assert len(Dynamics(config.model).motions) == 2
    config = lone({**CLUTTER, "detection_births.rates": [0.0]})
    engine = new_engine(config)
    filtered = track(engine, [scan_at(6.0 * k, [[5e3, 1.0]]) for k in range(1, 9)])
    assert [len(found) for found in filtered] == [0] * 8


@pytest.mark.parametrize("steps", [1e-3, 6.0])
def test_engine_takes_its_own_snapshot_whatever_its_numbers(steps):
    config = lone(
        {
            **CLUTTER,
            "radar.range_std": 1e-3,
            "radar.azimuth_std_deg": 1e-6,
            "cv.noise_density": 1e-9,
        }
    )
    rng = np.random.default_rng(7)
    engine, other = started(config), new_engine(config)
    for scan in scans_along(config.model.radars[0], steps * np.arange(1, 9), rng):
        engine.step(scan)
        other.restore(engine.snapshot())
