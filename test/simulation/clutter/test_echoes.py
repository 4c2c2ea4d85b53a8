from dataclasses import replace

import numpy as np
import pytest
from lone import lone

from phd_jdtc_ros.core.sensors.range_rate import RangeRateModel
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.clutter.echoes import Echoes
from phd_jdtc_ros.simulation.simulate import detect

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
