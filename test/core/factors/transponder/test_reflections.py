"""Replies far from their target: a single one moves nothing, and further ones that agree do."""

import numpy as np
import pytest
from hard_turns import PERIOD_S, measured, tracker
from lone import lone, scan_at
from scipy.integrate import trapezoid

from phd_jdtc_ros.core.factors.transponder.reflections import (
    FARTHEST,
    NEAREST,
    RATE,
    log_reflections,
)
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.types import Detections

EXACT = np.array([5.0, np.radians(0.01)])
PLACE = np.array([6e3, -4e3])
CERTAIN = {"radar.detection_probability": 0.99}


def of(distance, existence=1.0):
    """Return the intensity of reflections in the plane, so far from a target."""
    (radar,) = lone({"radar.clutter_rate": 1.0}).model.radars
    place = np.array([[3e3, 4e3]])
    plot = radar.measure(np.array([[place[0, 0] + distance, 0.0, place[0, 1], 0.0, 0.0]]))
    column = np.zeros(1, dtype=np.int64)
    report = View.of(radar, Detections(plot, None))
    ratio = log_reflections(place, np.array([existence]), column, report)
    return float(np.exp(ratio + report.log_clutter + radar.log_jacobian(plot))[0])


def test_reflections_have_a_uniform_logarithm_of_the_distance():
    annulus = np.geomspace(NEAREST, FARTHEST, 200)
    density = [of(distance) * 2.0 * np.pi * distance for distance in annulus.tolist()]
    assert trapezoid(density, annulus) == pytest.approx(RATE, rel=1e-3)
    assert of(1.0) == pytest.approx(of(NEAREST), rel=1e-6)
    assert of(500.0, existence=0.25) == pytest.approx(0.25 * of(500.0), rel=1e-9)


def positions(places, given=None):
    """Return the filtered positions of one aircraft with an address, measured at these places."""
    rng, found = np.random.default_rng(31), []
    one = tracker(given={**CERTAIN, **(given or {})})
    for index, place in enumerate(places):
        plot = measured(place[None], EXACT, rng)
        scan = scan_at((index + 1) * PERIOD_S, plot, address=np.array([77]))
        (estimates,) = one.step(scan).filtered
        own = estimates.attributes.address == 77
        found.append((estimates.position[own], estimates.track_id[own].tolist()))
    return found


@pytest.mark.parametrize("away", [100.0, 320.0, 1e3, 1e4])
def test_single_far_reply_does_not_move_a_parked_aircraft(away):
    places = np.tile(PLACE, (20, 1))
    places[12, 0] += away
    found = positions(places)
    for position, numbers in found[12:]:
        assert numbers == [1]
        assert np.hypot(*(position[0] - PLACE)) < 50.0


def test_far_replies_that_agree_are_the_aircraft_with_its_number():
    places = np.tile(PLACE, (24, 1))
    places[12:, 0] += 700.0
    position, numbers = positions(places)[-1]
    assert numbers == [1]
    assert np.hypot(*(position[0] - places[-1])) < 50.0
