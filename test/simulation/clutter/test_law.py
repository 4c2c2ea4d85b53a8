from dataclasses import replace

import numpy as np
import pytest
from lone import lone
from reference import resolve
from scenario_blocks import UNIFORM
from scipy.stats import norm
from sweep import configuration

from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.targets.amplitude_density import level_db, threshold_for
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.clutter import (
    NOISE,
    Echoes,
    LogNormalClutter,
    RayleighClutter,
    UniformClutter,
)
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import detect, simulate, simulate_with_sources
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports

RADARS = resolve({}).model.radars
TAU = threshold_for(1e-3)
COUNT = 20_000
GIVEN = {
    "radar.fields.range_rate": "rr",
    "radar.range_rate_std": 0.2,
    "radar.range_std": 0.5,
    "radar.azimuth_std_deg": 0.2,
    "radar.fov_deg": [-60.0, 60.0],
    "radar.max_range": 400.0,
    "radar.clutter_max_range": 400.0,
    "radar.position": [0.0, 0.0],
    "radar.yaw_deg": 0.0,
}
(RADAR,) = lone(GIVEN).model.radars
STATE = np.array([100.0, -30.0, 20.0, 5.0, 0.0])


def rayleigh(level):
    """Return the log tail of envelopes whose mean square relative to noise is a level."""
    return lambda threshold: -0.5 * threshold**2 / level


def log_normal(median_db, std_db):
    """Return the log tail of envelopes whose level in dB is Gaussian."""
    return lambda threshold: norm.logsf(level_db(np.array(threshold)), median_db, std_db)


def drawn(law, threshold=TAU):
    return law.draw(threshold, COUNT, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("law", "tail"),
    [
        (NOISE, rayleigh(1.0)),
        (RayleighClutter(10.0), rayleigh(10.0)),
        (LogNormalClutter(12.0, 5.0), log_normal(12.0, 5.0)),
        (LogNormalClutter(-30.0, 3.0), log_normal(-30.0, 3.0)),
    ],
)
def test_what_is_drawn_has_the_tail_of_its_law(law, tail):
    envelope = drawn(law)
    assert envelope.min() >= TAU
    for threshold in np.quantile(envelope, [0.2, 0.5, 0.9]):
        above = np.mean(envelope > threshold)
        expected = np.exp(tail(threshold) - tail(TAU))
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
    """A tracker that learns its clutter is given the same data."""
    scene = paper_scenario(RADARS)
    assumed = resolve({"radar_1.clutter_amplitude": "learned"}).model.radars
    other = paper_scenario(assumed)
    for (_, one), (_, two) in zip(simulate(scene, 0)[:3], simulate(other, 0)[:3], strict=True):
        for before, after in zip(one.detections, two.detections, strict=True):
            np.testing.assert_array_equal(before.amplitude, after.amplitude)


def truth(count=2000):
    number = np.arange(count)
    return Truth(0, np.tile(STATE, (count, 1)), number + 1, np.zeros(count, dtype=int))


def detected(radar=RADAR, echoes=None, count=2000):
    rng = np.random.default_rng(0)
    return detect(truth(count), np.full(count, 100.0), radar, rng, echoes=echoes)


def test_range_rates_of_targets_have_the_radars_noise_and_fold():
    found, source = detected()
    exact = RADAR.range_rate_of(STATE[None])[0]
    error = found.range_rate[source > 0] - exact
    assert abs(error.mean()) < 4.5 * 0.2 / np.sqrt(len(error))
    assert error.std() == pytest.approx(0.2, rel=4.5 / np.sqrt(2 * len(error)))
    folded, source = detected(replace(RADAR, range_rate=RangeRateModel(0.2, 20.0)))
    np.testing.assert_allclose(np.median(folded.range_rate[source > 0]), exact + 20.0, atol=0.02)
    assert np.abs(folded.range_rate).max() <= 10.0


def test_clutter_of_radars_with_range_rates_has_uniform_ones():
    radar = replace(RADAR, clutter_rate=20_000.0, range_rate=RangeRateModel(0.2, 40.0))
    found, _ = detected(radar, count=0)
    azimuth = np.degrees(found.measurement[:, 1])
    assert len(found) == pytest.approx(20_000, abs=4.5 * np.sqrt(20_000))
    for value, low, width in ((azimuth, -60.0, 120.0), (found.range_rate, -20.0, 40.0)):
        share = np.histogram((value - low) / width, bins=10, range=(0.0, 1.0))[0]
        assert share.sum() == len(found)
        assert np.abs(share / len(found) - 0.1).max() < 4.5 * np.sqrt(0.09 / len(found))
    assert detected(replace(RADAR, range_rate=None))[0].range_rate is None


def test_targets_answer_several_times_along_their_course():
    echoes = Echoes(probability=0.25, most=3, length_std=2.0, width_std=0.5)
    sources, row = echoes.sources(truth().state, PLANAR, np.random.default_rng(0))
    count = np.bincount(row, minlength=2000)
    assert np.count_nonzero(count) / 2000 == pytest.approx(0.25, abs=0.045)
    assert np.bincount(count)[1:] / 500 == pytest.approx([1 / 3] * 3, abs=0.1)
    offset = (sources - STATE)[:, [0, 2]]
    course = STATE[[1, 3]] / np.hypot(*STATE[[1, 3]])
    along, across = offset @ course, offset @ [-course[1], course[0]]
    assert along.std() == pytest.approx(2.0, rel=0.1)
    assert across.std() == pytest.approx(0.5, rel=0.1)
    np.testing.assert_array_equal(sources[:, [1, 3]], np.tile(STATE[[1, 3]], (len(sources), 1)))


def test_echoes_are_detections_of_their_targets():
    echoes = Echoes(probability=1.0, most=1, length_std=1.0, width_std=1.0)
    found, source = detected(echoes=echoes, count=500)
    _, once = detected(count=500)
    first, second = np.bincount(once, minlength=501)[1:], np.bincount(source, minlength=501)[1:]
    assert first.max() == 1
    assert second.max() == 2
    # Each echo is detected, or not, by itself.
    assert (second > 1).mean() == pytest.approx(0.999, abs=0.01)
    assert len(found.range_rate) == len(found)


def document(echoes):
    return {"scans": 2, "targets": [], "echoes": echoes}


def test_echoes_of_a_scenario_file_are_those_of_its_radars():
    given = {"radar": {"probability": 0.2, "most": 1}}
    scenario = scenario_file.resolve(document(given), (RADAR,))
    assert scenario.echoes == (Echoes(0.2, 1, 1.2, 0.5),)
    assert scenario_file.resolve({"scans": 2, "targets": []}, (RADAR,)).echoes == ()
