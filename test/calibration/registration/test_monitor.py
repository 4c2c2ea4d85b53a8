"""A running tracker's radars are compared with the tracks that others see too."""

from dataclasses import replace

import numpy as np
import pytest
from estimate_sets import estimates, states
from reference import resolve

from phd_jdtc_ros.calibration.comparison import Comparison
from phd_jdtc_ros.calibration.registration.monitor import LEAST, MEMORY, RegistrationMonitor
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.sensors.bias import SensorBias
from phd_jdtc_ros.core.types import (
    CONFIRMED,
    TENTATIVE,
    UNKNOWN_COVERAGE,
    Coverage,
    Detections,
    Scan,
)
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

CONFIG = resolve({"lag": 0})
RADARS = CONFIG.model.radars
SCANS = [scan for _, scan in simulate(paper_scenario(RADARS), 6)][:60]


def monitored(scans):
    """Return the mean residuals after the tracker has stepped through scans."""
    engine, monitor = new_engine(CONFIG), RegistrationMonitor(CONFIG.model)
    comparison = Comparison(CONFIG.model, [monitor])
    for scan in scans:
        comparison.add_scan(scan, engine.step(scan).filtered)
    return monitor.mean_residuals()


def off(scan, error):
    """Return a scan whose second radar has an error of (range, azimuth)."""
    first, second = scan.detections
    _, wrong = SensorBias(error[0], 0.0, error[1]).apply_to(scan.stamp_ns, second)
    return Scan(scan.stamp_ns, (first, wrong))


def test_radars_without_bias_have_no_significant_residuals():
    for found in monitored(SCANS):
        assert found.residuals > LEAST
        assert found.significant == (False, False)
        # The residuals are noise, whose size is sigma.
        assert (np.abs(found.mean) < 4.0 * found.sigma).all()
        assert (found.sigma < RADARS[0].noise_std).all()


@pytest.mark.parametrize(("error", "axis"), [((900.0, 0.0), 0), ((0.0, np.radians(4.0)), 1)])
def test_a_biased_radar_has_significant_residuals_of_the_sign_of_its_bias(error, axis):
    found = monitored([off(scan, error) for scan in SCANS])
    assert found[1].significant[axis]
    assert found[1].mean[axis] > 0.25 * error[axis]
    # The tracks are between the two radars, so that the other one seems to be off the other way.
    assert found[0].mean[axis] < 0.0


CALM = estimates(
    states([[5e3, 0.0]], (10.0, 0.0)),
    np.diag([1e4, 1.0, 1e4, 1.0, 1e-8]),
    stamp_ns=10**9,
    track_id=np.ones(1, dtype=int),
)


def seen(radars, *measurement, count=3, error=0.0, coverage=None):
    """Return what is seen of a track that goes on as it is, by the radars of each scan.

    The azimuths of the second radar have an error.
    """
    monitor = RegistrationMonitor(CONFIG.model)
    comparison = Comparison(CONFIG.model, [monitor])
    for k in range(count):
        stamp_ns = 10**9 * (1 + 6 * k)
        found = replace(CALM, stamp_ns=stamp_ns)
        state = found.state[0] + [60.0, 0.0, 0.0, 0.0, 0.0]
        given = [
            Detections(
                np.concatenate([RADARS[r].measure(state[None]) + off, *measurement]),
                None,
                coverage=coverage,
            )
            if r in radars
            else None
            for r, off in enumerate([np.zeros(2), np.array([0.0, error])])
        ]
        comparison.add_scan(Scan(stamp_ns, (None, None)), [found])
        comparison.add_scan(Scan(stamp_ns + 6 * 10**9, tuple(given)), [])
    return monitor.mean_residuals()


def test_residuals_are_those_of_the_predicted_track():
    first, second = seen((0, 1))
    # The first detection of all has no other radar to be compared with.
    assert (first.residuals, second.residuals) == (2, 3)
    np.testing.assert_allclose(first.mean, 0.0, atol=1e-9)


def test_only_unambiguous_tracks_of_several_radars_are_compared():
    assert [found.residuals for found in seen((1,))] == [0, 0]
    assert np.isnan(seen((1,))[0].mean).all()
    near = RADARS[0].measure(CALM.state) + np.array([100.0, 0.0])
    assert [found.residuals for found in seen((0, 1), near)] == [0, 0]


def test_a_radar_whose_detections_are_far_from_the_tracks_of_others_is_noticed():
    for radar in seen((0, 1), count=100):
        assert np.isnan(radar.near)
    first, second = seen((0, 1), count=100, error=np.radians(20.0))
    assert np.isnan(first.near)  # Nobody but this radar sees the track.
    assert (second.residuals, second.near) == (0, 0.0)
    assert np.isnan(seen((0, 1), count=50, error=np.radians(20.0))[1].near)
    # A radar that does not look there is not expected to see it.
    for coverage in (UNKNOWN_COVERAGE, Coverage(np.pi, 0.5)):
        looks = seen((0, 1), count=100, error=np.radians(20.0), coverage=coverage)
        assert np.isnan(looks[1].near)


@pytest.mark.parametrize("changes", [{"track_state": [TENTATIVE]}, {"track_id": [0]}])
def test_tentative_tracks_are_not_used(changes, monkeypatch):
    changed = {name: np.array(value) for name, value in changes.items()}
    monkeypatch.setitem(globals(), "CALM", replace(CALM, **changed))
    assert [found.residuals for found in seen((0, 1))] == [0, 0]
    assert CONFIRMED != TENTATIVE


def test_old_residuals_are_forgotten():
    monitor = RegistrationMonitor(CONFIG.model)
    mean = monitor._means[0]
    for _ in range(2 * MEMORY):
        mean.add(np.array([300.0, 0.0]))
    for _ in range(4 * MEMORY):
        mean.add(np.array([0.0, 0.0]))
    assert abs(mean.mean[0]) < 300.0 * np.exp(-4.0) * 1.1


def test_a_new_run_has_other_tracks_and_keeps_the_means():
    engine, monitor = new_engine(CONFIG), RegistrationMonitor(CONFIG.model)
    comparison = Comparison(CONFIG.model, [monitor])
    for scan in SCANS[:20]:
        comparison.add_scan(scan, engine.step(scan).filtered)
    before = monitor.mean_residuals()
    comparison.forget_tracks()
    comparison.add_scan(SCANS[20], ())
    assert [found.residuals for found in monitor.mean_residuals()] == [d.residuals for d in before]
    assert before[0].residuals > 10
