from dataclasses import replace

import numpy as np
import pytest
from scenario_blocks import UNIFORM
from sweep import configuration

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.clutter.amplitude_law import LogNormal, Rayleigh, level_db
from phd_jdtc_ros.core.targets.amplitude_density import threshold_for
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.clutter.law import (
    NOISE,
    LogNormalClutter,
    RayleighClutter,
    UniformClutter,
)
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate, simulate_with_sources
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports

RADARS = resolve({}).model.radars
TAU = threshold_for(1e-3)
COUNT = 20_000


def drawn(law, threshold=TAU):
    return law.draw(threshold, COUNT, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("law", "assumed"),
    [
        (NOISE, Rayleigh()),
        (RayleighClutter(10.0), Rayleigh(10.0)),
        (LogNormalClutter(12.0, 5.0), LogNormal(12.0, 5.0)),
        (LogNormalClutter(-30.0, 3.0), LogNormal(-30.0, 3.0)),
    ],
)
def test_what_is_drawn_has_the_tail_of_the_law_that_a_tracker_assumes(law, assumed):
    envelope = drawn(law)
    assert envelope.min() >= TAU
    for threshold in np.quantile(envelope, [0.2, 0.5, 0.9]):
        above = np.mean(envelope > threshold)
        expected = np.exp(assumed.log_share(float(threshold), TAU))
        assert expected == pytest.approx(above, abs=4.5 * 0.5 / np.sqrt(COUNT))


def test_uniform_clutter_is_uniform_in_decibels_above_the_threshold():
    level = level_db(drawn(UniformClutter(0.0, 20.0)))
    least = level_db(np.array(TAU))
    share = np.histogram(level, bins=10, range=(least, 20.0))[0] / COUNT
    assert share.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(share, 0.1, atol=4.5 * 0.3 / np.sqrt(COUNT))


def test_another_law_changes_the_amplitudes_of_clutter_and_nothing_else():
    """Of both kinds, one number is drawn for each envelope."""
    scene = replace(paper_scenario(RADARS), scans=5)
    loud = replace(scene, clutter=(RayleighClutter(100.0),) * 2)
    for one, other in zip(
        simulate_with_sources(scene, 1), simulate_with_sources(loud, 1), strict=True
    ):
        for before, after, source in zip(
            one[1].detections, other[1].detections, one[2], strict=True
        ):
            np.testing.assert_array_equal(before.measurement, after.measurement)
            changed = before.amplitude != after.amplitude
            np.testing.assert_array_equal(changed, source == 0)


def test_a_scenario_file_gives_every_radar_its_law():
    document = {
        "clutter": {
            "radar_1": UNIFORM,
            "radar_2": {"law": "log_normal", "level_db": 12, "std_db": 6.0},
        }
    }
    found = scenario_file.resolve(document, RADARS)
    assert found.clutter == (UniformClutter(10.0, 20.0), LogNormalClutter(12.0, 6.0))
    one = {"clutter": {"radar_2": {"law": "rayleigh", "level_db": 10.0}}}
    assert scenario_file.resolve(one, RADARS).clutter == (NOISE, RayleighClutter(10.0))
    assert [scenario_file.resolve({}, RADARS).law(radar) for radar in (0, 1)] == [NOISE, NOISE]


def test_radars_that_turn_have_clutter_of_their_law_too():
    config = configuration({"radar.clutter_rate": 50.0})
    scene = replace(
        paper_scenario(config.model.radars),
        targets=(),
        scans=5,
        interval_s=4.0,
        clutter=(UniformClutter(10.0, 20.0),),
    )
    reports = simulate_reports(scene, config.inputs, 0)
    level = level_db(np.concatenate([report.detections.amplitude for report in reports]))
    assert len(level) > 50
    assert level.min() >= 10.0
    assert level.max() <= 20.0


def test_clutter_above_noise_is_the_scenarios_and_not_the_trackers():
    """A tracker that learns its clutter, or assumes another, is given the same data."""
    scene = paper_scenario(RADARS)
    assumed = resolve(
        {"radar_1.clutter_amplitude": "learned", "radar_2.clutter_amplitude": "rayleigh 10"}
    ).model.radars
    other = paper_scenario(assumed)
    for (_, one), (_, two) in zip(simulate(scene, 0)[:3], simulate(other, 0)[:3], strict=True):
        for before, after in zip(one.detections, two.detections, strict=True):
            np.testing.assert_array_equal(before.amplitude, after.amplitude)
