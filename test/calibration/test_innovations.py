"""The configured noise is compared with what detections show of it."""

from dataclasses import replace

import numpy as np
import pytest
from estimate_sets import estimates, states
from mast import mast
from reference import resolve

from phd_jdtc_ros.calibration.comparison import Comparison
from phd_jdtc_ros.calibration.innovations import LEAST_BROKEN, SAMPLE, InnovationMonitor
from phd_jdtc_ros.columns import anomalies
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.factors import Noise
from phd_jdtc_ros.core.sensors.gaussians import HeightPrior
from phd_jdtc_ros.core.types import Coverage, Detections, Scan
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

TRUE = resolve({"lag": 0})
SCANS = [scan for _, scan in simulate(paper_scenario(TRUE.model.radars), 6)]
NO, BOTH, AZIMUTH = [False, False], [True, True], [False, True]


def configured(scale, azimuth_scale=None):
    """Return the configuration with all noise scaled, or that of azimuths by another factor."""
    given = {"lag": 0}
    for radar in ("radar_1", "radar_2"):
        given[f"{radar}.range_std"] = TRUE.values[f"{radar}.range_std"] * scale
        azimuth = TRUE.values[f"{radar}.azimuth_std_deg"]
        given[f"{radar}.azimuth_std_deg"] = azimuth * (azimuth_scale or scale)
    return resolve(given)


def monitored(config):
    """Return the fits after each scan of the reference scenario."""
    engine, monitor = new_engine(config), InnovationMonitor(config.model)
    comparison, found = Comparison(config.model, [monitor]), []
    for scan in SCANS:
        comparison.add_scan(scan, engine.step(scan).filtered)
        found.append(monitor.fits())
    return found


def test_right_noise_is_never_warned_of():
    for fits in monitored(TRUE):
        assert not any((fit.too_small | fit.too_large).any() for fit in fits)
    assert all(fit.innovations > 100 for fit in fits)
    assert all((np.abs(np.log(fit.noise)) < 0.4).all() for fit in fits)


def test_warning_names_the_component_whose_noise_is_wrong():
    for fit in monitored(configured(1.0, azimuth_scale=0.1))[-1]:
        assert fit.too_small.tolist() == AZIMUTH
        assert fit.noise[1] > 5.0


@pytest.mark.parametrize(
    ("scale", "small", "large"),
    [(0.01, BOTH, NO), (0.1, BOTH, NO), (4.0, NO, BOTH), (10.0, NO, BOTH)],
)
def test_wrong_noise_is_noticed_of_every_radar(scale, small, large):
    for fit in monitored(configured(scale))[-1]:
        assert (fit.too_small.tolist(), fit.too_large.tolist()) == (small, large)


ALONE = resolve({"sensors": ["one"], "one.range_std": 10.0, "one.azimuth_std_deg": 1.0}).model
STILL = estimates(
    states([[5e3, 0.0]]),
    np.zeros((5, 5)),
    class_probability=np.ones((1, 2)) / 2.0,
    track_id=np.array([1]),
)


def looks(monitor, looks, tracks=STILL, coverage=None):
    """Let tracks, whose places are known, be seen in each of some looks; return the radar's fit."""
    reports = [Detections(np.array(each), None, coverage=coverage) for each in looks]
    return compared(monitor, reports, tracks)


def compared(monitor, reports, tracks=STILL):
    """Let tracks be seen in reports, each shortly after estimates; return the sensor's fit."""
    comparison = Comparison(monitor.model, [monitor])
    for number, report in enumerate(reports):
        begin_ns = number * 10**9
        comparison.add_scan(Scan(begin_ns, (None,)), (replace(tracks, stamp_ns=begin_ns),))
        comparison.add_scan(Scan(begin_ns + 10**8, (report,)), ())
    return monitor.fits()[0]


def scattered(count, share, seed=5):
    """Return looks at one target with errors of a share of the configured noise."""
    errors = share * np.random.default_rng(seed).normal(0.0, [10.0, np.radians(1.0)], (count, 2))
    return (np.array([5e3, 0.0]) + errors)[:, None]


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
    fit = looks(InnovationMonitor(ALONE), [measurements], coverage=coverage)
    assert fit.innovations == seen


@pytest.mark.filterwarnings("error")
def test_detections_at_the_radar_itself_show_no_noise():
    seen = [[(0.0, 0.1 * number)] for number in range(40)]
    fit = looks(InnovationMonitor(ALONE), seen, replace(STILL, state=states([[0.0, 0.0]])))
    assert np.isnan(fit.noise[1])
    assert fit.innovations == len(seen)


def test_differences_are_compared_with_the_whole_covariance_of_the_noise():
    sensor = mast(position=(0.0, 0.0))
    root = np.linalg.cholesky([[1.0, 0.9], [0.9, 1.0]])
    errors = 50.0 * np.random.default_rng(3).normal(size=(200, 2)) @ root.T
    reports = [
        Detections(
            np.array([5e3, 0.0]) + error[None],
            None,
            noise_std=np.full((1, 2), 100.0),
            noise_correlation=np.array([0.9]),
        )
        for error in errors
    ]
    fit = compared(InnovationMonitor(replace(ALONE, radars=(sensor,))), reports)
    np.testing.assert_allclose(fit.noise, 0.5, atol=0.1)


def positions_of(offset, prior=None):
    """Return the comparison of a sensor of positions with a track, given each detection's error."""
    sensor = mast(3.0, position=(0.0, 0.0), height_prior=prior)
    reports = [
        Detections(np.array([5e3 + 2.0 * number, 0.5 * number])[None] + error, None)
        for number, error in enumerate(offset)
    ]
    return compared(InnovationMonitor(replace(ALONE, radars=(sensor,))), reports)


def test_smoothed_positions_do_not_show_that_the_noise_is_too_large():
    # Those of a driver's own tracker, and those of a vehicle at rest in whole metres.
    for offset in (np.zeros((200, 2)), -np.array([[2.0, 0.5]]) * np.arange(200)[:, None]):
        fit = positions_of(offset)
        assert fit.innovations > 50
        assert not fit.too_large.any()
        assert anomalies.of_noise(fit) is None


# In space a place has a height, which is not compared.
@pytest.mark.parametrize("prior", [None, HeightPrior(1.0, 5.0)])
def test_wrong_noise_of_positions_names_its_parameter(prior):
    fit = positions_of(0.3 * np.random.default_rng(5).standard_normal((300, 2)), prior)
    text = anomalies.of_noise(fit)
    assert text.startswith("innovations are ")
    assert "x is off by " in text
    assert text.endswith(
        "do not show here); check mast.position_std, or the fields of standard deviations; tune "
        "finds them in a recording"
    )


def test_detections_between_two_tracks_are_of_neither():
    two = estimates(
        STILL.state[[0, 0]] + np.array([[0.0] * 5, [600.0] + [0.0] * 4]),
        np.zeros((5, 5)),
        track_id=np.array([1, 2]),
        track_state=np.ones(2, int),
    )
    assert looks(InnovationMonitor(ALONE), [[(5.25e3, 0.0)]], two).innovations == 0


@pytest.mark.parametrize(("share", "small", "large"), [(0.4, NO, BOTH), (1, NO, NO), (3, BOTH, NO)])
def test_manoeuvres_and_wrong_predictions_are_no_noise(share, small, large):
    """A target 400 m beside its track accelerates with 20 m/s^2 to and fro."""
    acceleration = 20.0 * np.repeat([1.0, -1.0, -1.0, 1.0], 20)
    distance = 400.0 + np.cumsum(np.cumsum(np.tile(acceleration, 5)))
    seen = scattered(len(distance), share)
    seen[:, 0, 0] += distance
    fit = looks(InnovationMonitor(ALONE), seen)
    assert fit.axes[0] > 10.0
    assert (fit.too_small.tolist(), fit.too_large.tolist()) == (small, large)


def test_verdict_stays_until_it_is_clearly_otherwise():
    monitor, between = InnovationMonitor(ALONE), 0.65
    assert not looks(monitor, scattered(801, between)).too_large.any()
    assert looks(monitor, scattered(801, 0.5)).too_large.all()
    assert looks(monitor, scattered(801, between)).too_large.all()
    assert not looks(monitor, scattered(801, 0.9)).too_large.any()


def test_few_detections_show_only_a_noise_that_is_far_off():
    assert not looks(InnovationMonitor(ALONE), scattered(12, 2.0)).too_small.any()
    assert looks(InnovationMonitor(ALONE), scattered(12, 100.0)).too_small.all()


def test_tracks_that_all_break_far_from_their_detections_show_too_small_a_noise():
    monitor = InnovationMonitor(ALONE)
    comparison = Comparison(ALONE, [monitor])
    for number in range(LEAST_BROKEN + 1):
        assert not monitor.fits()[0].too_small.any()
        begin_ns = number * 10**11
        track = replace(STILL, stamp_ns=begin_ns, track_id=np.array([number + 1]))
        comparison.add_scan(Scan(begin_ns, (None,)), (track,))
        report = Detections(np.array([[5e3 + 2000.0, 0.0]]), None)
        comparison.add_scan(Scan(begin_ns + 10**8, (report,)), ())
    assert monitor.fits()[0].too_small.tolist() == [True, False]


def test_rounded_detections_of_a_target_at_rest_show_no_noise():
    fit = looks(InnovationMonitor(ALONE), [[(5e3, 0.0)]] * 60)
    assert fit.innovations == 60
    assert not fit.too_large.any()


def test_learned_noise_and_the_smallest_plausible_one_are_not_too_large():
    (radar,) = ALONE.radars
    seen = scattered(300, 0.3)
    assert looks(InnovationMonitor(ALONE), seen).too_large.all()
    learned = {radar.name: (Noise(np.array([True, False, False])),)}
    fit = looks(InnovationMonitor(replace(ALONE, factors=learned)), seen)
    assert fit.too_large.tolist() == AZIMUTH
    bounded = radar.changed(least_std=(10.0, 0.0))
    fit = looks(InnovationMonitor(replace(ALONE, radars=(bounded,))), seen)
    assert fit.too_large.tolist() == AZIMUTH


def test_some_tracks_of_a_crowd_are_followed():
    count = 2 * SAMPLE
    crowd = estimates(
        states([[5e3 + 100.0 * number, 0.0] for number in range(count)]),
        np.zeros((5, 5)),
        class_probability=np.ones((count, 2)) / 2.0,
        track_id=np.arange(count),
        track_state=np.ones(count, int),
    )
    rng = np.random.default_rng(2)
    seen = np.column_stack([crowd.position[:, 0], np.zeros(count)])
    noise = [2.0, np.radians(0.1)]
    fit = looks(InnovationMonitor(ALONE), seen + rng.normal(0.0, noise, (8, count, 2)), crowd)
    assert 4 * SAMPLE < fit.innovations <= 8 * SAMPLE
    assert fit.too_large.all()
