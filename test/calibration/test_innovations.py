"""The configured noise is compared with what detections show of it."""

from dataclasses import replace

import numpy as np
import pytest
from estimate_sets import estimates, states
from position_sensor import PositionSensor

from phd_jdtc_ros.calibration.innovations import (
    BELOW_EXPECTED,
    HYSTERESIS,
    MIN_FOR_TOO_LARGE,
    MIN_FOR_TOO_SMALL,
    SAMPLE,
    TWO,
    InnovationMonitor,
)
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.types import Coverage, Detections, Scan
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

TRUE = resolve({"engine": "gaussian", "lag": 0})
SCANS = [scan for _, scan in simulate(paper_scenario(TRUE.model.radars), 6)]


def configured(scale, azimuth_scale=None):
    """Return the configuration with all noise scaled, or that of azimuths by another factor."""
    given = {"engine": "gaussian", "lag": 0}
    for radar in ("radar_1", "radar_2"):
        given[f"{radar}.range_std"] = TRUE.values[f"{radar}.range_std"] * scale
        azimuth = TRUE.values[f"{radar}.azimuth_std_deg"]
        given[f"{radar}.azimuth_std_deg"] = azimuth * (azimuth_scale or scale)
    return resolve(given)


def monitored(config):
    """Return the fits after each scan of the reference scenario."""
    engine, monitor = new_engine(config), InnovationMonitor(config.model)
    found = []
    for scan in SCANS:
        monitor.add_scan(scan, engine.step(scan).filtered)
        found.append(monitor.fits())
    return found


def test_right_noise_is_never_warned_of_and_axes_show_which_is_wrong():
    for fits in monitored(TRUE):
        assert not any(fit.noise_too_small or fit.noise_too_large for fit in fits)
    assert all(fit.innovations > MIN_FOR_TOO_LARGE for fit in fits)
    assert all((np.abs(fit.axes - 1.0) < 0.4).all() for fit in fits)
    for fit in monitored(configured(1.0, azimuth_scale=0.1))[-1]:
        assert fit.noise_too_small
        assert fit.axes[1] > 5.0 > 2.0 > fit.axes[0]


@pytest.mark.parametrize(
    ("scale", "verdict"), [(0.01, (True, False)), (0.1, (True, False)), (10.0, (False, True))]
)
def test_wrong_noise_is_noticed_of_every_radar(scale, verdict):
    fits = monitored(configured(scale))[-1]
    assert [(fit.noise_too_small, fit.noise_too_large) for fit in fits] == [verdict, verdict]


ALONE = resolve({"sensors": ["one"], "one.range_std": 10.0, "one.azimuth_std_deg": 1.0}).model
STILL = estimates(
    states([[5e3, 0.0]]),
    np.zeros((5, 5)),
    class_probability=np.ones((1, 2)) / 2.0,
    track_id=np.array([1]),
)


def looks(monitor, measurements, coverage=None, times=1):
    """Let one track, whose place is known, be seen some times; return the radar's fit."""
    report = Detections(np.array(measurements), None, coverage=coverage)
    for _ in range(times):
        monitor.add_scan(Scan(0, (None,)), (STILL,))
        monitor.add_scan(Scan(10**8, (report,)), ())
    return monitor.fits()[0]


@pytest.mark.parametrize(
    ("measurements", "coverage", "seen"),
    [
        ([(5e3 + 400.0, 0.0)], None, 1),
        ([(5e3 + 400.0, 0.0), (5e3 - 900.0, 0.0)], None, 0),
        ([(5e3 + 400.0, 0.0), (5e3 - 1300.0, 0.0)], None, 1),
        ([(5e3, 1.0)], Coverage(0.5, 1.0), 0),
    ],
    ids=["alone", "two near", "one near", "elsewhere"],
)
def test_detection_is_a_tracks_if_it_is_beyond_doubt(measurements, coverage, seen):
    assert looks(InnovationMonitor(ALONE), measurements, coverage).innovations == seen


def test_innovations_are_compared_with_the_whole_covariance_of_the_noise():
    sensor = PositionSensor(
        name="mast", position=(0.0, 0.0), yaw=0.0, threshold=3.0, clutter_rate=2.0
    )
    found = Detections(
        np.array([[5.1e3, 100.0]]),
        None,
        noise_std=np.full((1, 2), 100.0),
        noise_correlation=np.array([0.9]),
    )
    monitor = InnovationMonitor(replace(ALONE, radars=(sensor,)))
    monitor.add_scan(Scan(0, (None,)), (STILL,))
    monitor.add_scan(Scan(10**8, (found,)), ())
    (fit,) = monitor.fits()
    assert fit.ratio_to_expected == pytest.approx(2.0 / 1.9 / TWO, rel=0.01)
    assert fit.ratio_to_noise == pytest.approx(2.0 / TWO)


def test_detections_between_two_tracks_are_of_neither():
    two = estimates(
        STILL.state[[0, 0]] + np.array([[0.0] * 5, [600.0] + [0.0] * 4]),
        np.zeros((5, 5)),
        track_id=np.array([1, 2]),
        track_state=np.ones(2, int),
    )
    monitor = InnovationMonitor(ALONE)
    monitor.add_scan(Scan(0, (None,)), (two,))
    monitor.add_scan(Scan(10**8, (Detections(np.array([[5.25e3, 0.0]]), None),)), ())
    assert monitor.fits()[0].innovations == 0


def test_verdict_stays_until_it_is_clearly_otherwise():
    """Squares of 2 ln 2 times the share are that share of what is expected."""
    monitor = InnovationMonitor(replace(ALONE, modes=ALONE.modes))

    def after(share):
        off = 10.0 * np.sqrt(share * 2.0 * np.log(2.0))
        return looks(monitor, [(5e3 + off, 0.0)], times=200)

    least = BELOW_EXPECTED
    between = 0.5 * (least + least / HYSTERESIS)
    assert [after(share).noise_too_large for share in (between, 0.9 * least, between, 0.5)] == [
        False,
        True,
        True,
        False,
    ]


def test_few_innovations_reveal_too_small_a_noise_and_many_too_large_a_noise():
    monitor = InnovationMonitor(ALONE)
    far = [(5e3 + 2000.0, 0.0)]
    assert not looks(monitor, far, times=MIN_FOR_TOO_SMALL - 1).noise_too_small
    assert looks(monitor, far).noise_too_small
    monitor = InnovationMonitor(ALONE)
    near = [(5e3 + 0.1, 0.0)]
    assert not looks(monitor, near, times=MIN_FOR_TOO_LARGE - 1).noise_too_large
    assert looks(monitor, near).noise_too_large


def test_some_tracks_of_a_crowd_are_compared_and_others_in_the_next_scan():
    count = 2 * SAMPLE
    crowd = estimates(
        states([[5e3 + 100.0 * number, 0.0] for number in range(count)]),
        np.zeros((5, 5)),
        class_probability=np.ones((count, 2)) / 2.0,
        track_id=np.arange(count),
        track_state=np.ones(count, int),
    )
    # The ranges of one half of the detections are far off.
    off = np.where(np.arange(count) < SAMPLE, 1.0, 20.0)
    report = Detections(np.column_stack([crowd.position[:, 0] + off, np.zeros(count)]), None)
    monitor, fits = InnovationMonitor(ALONE), []
    for _ in range(3):
        monitor.add_scan(Scan(0, (None,)), (crowd,))
        monitor.add_scan(Scan(10**8, (report,)), ())
        fits.append(monitor.fits()[0])
    assert [fit.innovations for fit in fits] == [SAMPLE, 2 * SAMPLE, 3 * SAMPLE]
    # The median is that of the half of which more have been drawn.
    assert len({fit.axes[0] for fit in fits}) > 1
