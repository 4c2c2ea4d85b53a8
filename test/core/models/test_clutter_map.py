# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

from dataclasses import replace

import numpy as np
import pytest
from scenes import small

from phd_jdtc_ros.core.models import clutter_map
from phd_jdtc_ros.core.models.clutter_map import ClutterMap
from phd_jdtc_ros.core.types import Detections

RATE, MAX_RANGE = 10.0, 20e3
STD = np.array([10.0, np.radians(0.2)])
PLACE = np.array([[4e3, 1.0]])


def empty():
    return ClutterMap.of_noise(*STD)


def factor(places, at):
    return np.exp(places.log_factor(np.atleast_2d(at), RATE, MAX_RANGE))


def answered(turns, place=PLACE, places=None, rng=None):
    """Return the map after a reflector has answered in so many turns."""
    rng = rng or np.random.default_rng(0)
    places = places or empty()
    for _ in range(turns):
        seen = place + rng.standard_normal(place.shape) * STD
        places = places.after(seen, np.ones(len(place)), 1.0)
    return places


def test_an_empty_map_is_uniform():
    rng = np.random.default_rng(1)
    anywhere = np.stack([rng.uniform(0, 20e3, 50), rng.uniform(-np.pi, np.pi, 50)], axis=1)
    np.testing.assert_array_equal(empty().log_factor(anywhere, RATE, MAX_RANGE), 0.0)
    radar = small().model.radars[0]
    found = Detections(anywhere, None)
    np.testing.assert_array_equal(
        replace(radar, clutter_map=empty()).log_clutter_intensity(found),
        radar.log_clutter_intensity(found),
    )


def test_a_place_that_answers_has_more_clutter_and_others_less():
    places = answered(20)
    assert factor(places, PLACE)[0] > 1e4
    assert factor(places, [4e3, -1.0])[0] < 0.3
    assert factor(places, [4e3 + 200.0, 1.0])[0] < 0.3
    assert factor(places, [4e3, 1.0 + np.radians(4.0)])[0] < 0.3


def test_the_density_is_that_of_the_place_and_not_of_the_uniform_rate():
    """Whatever rate is configured, a cell's own rate is what was counted in it."""
    places = answered(50)
    few = places.log_factor(PLACE, 0.1, MAX_RANGE) + np.log(0.1)
    many = places.log_factor(PLACE, 100.0, MAX_RANGE) + np.log(100.0)
    np.testing.assert_allclose(few, many, atol=1e-2)


def test_one_detection_is_less_than_a_quay():
    once, often = answered(1), answered(20)
    assert factor(once, PLACE)[0] < 0.1 * factor(often, PLACE)[0]


def test_a_place_that_no_longer_answers_is_forgotten():
    places = answered(20)
    before = factor(places, PLACE)[0]
    for _ in range(300):
        places = places.after(np.zeros((0, 2)), np.zeros(0), 1.0)
    assert factor(places, PLACE)[0] < 0.01 * before
    for _ in range(1000):
        places = places.after(np.zeros((0, 2)), np.zeros(0), 1.0)
    assert len(places.cell) == 0
    assert places.turns == pytest.approx(clutter_map.MEMORY_TURNS, rel=0.01)


def test_the_azimuths_of_a_turn_close():
    places = answered(20, np.array([[4e3, np.pi]]))
    here = factor(places, [4e3, np.pi - 1e-9])
    np.testing.assert_allclose(factor(places, [4e3, -np.pi + 1e-9]), here, rtol=1e-5)
    assert here[0] > 1e4


def test_claimed_detections_are_not_in_the_map():
    places = empty().after(np.repeat(PLACE, 3, axis=0), np.zeros(3), 1.0)
    assert len(places.cell) == 0


def test_sectors_count_as_parts_of_a_turn():
    whole, parts = answered(1), empty()
    for sector in range(16):
        seen = PLACE if sector == 5 else np.zeros((0, 2))
        parts = parts.after(seen, np.ones(len(seen)), 1.0 / 16.0)
    assert parts.turns == pytest.approx(whole.turns, rel=0.01)
    assert parts.count.sum() == pytest.approx(1.0, rel=0.01)


def test_the_map_is_of_bounded_size(monkeypatch):
    monkeypatch.setattr(clutter_map, "MOST_CELLS", 100)
    rng = np.random.default_rng(2)
    places = answered(20)
    for _ in range(20):
        seen = np.stack([rng.uniform(0, 20e3, 50), rng.uniform(-3.0, 3.0, 50)], axis=1)
        places = places.after(seen, np.ones(50), 1.0)
        assert len(places.cell) <= 100
        assert (np.diff(places.cell) > 0).all()
    assert factor(places, PLACE)[0] > 1e4


@pytest.mark.parametrize("std", [(1e-9, 1e-12), (1e9, 10.0)])
def test_a_map_is_possible_for_any_noise(std):
    places = ClutterMap.of_noise(*std)
    seen = np.array([[0.0, -np.pi], [17e3, np.pi], [5.0, 0.0]])
    places = places.after(seen, np.ones(3), 1.0)
    for rate in (np.finfo(float).tiny, RATE):
        assert np.isfinite(places.log_factor(seen, rate, MAX_RANGE)).all()
