"""Air traffic seen by a turning radar, with the tracker's profile for it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.parameter_files import sections
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.targets import Flight, Leg

from .scenes import GOLDEN_ANGLE

PROFILE = Path("config/air_traffic.yaml")
TRACKER = "/tracker"
AIRCRAFT = 50
SECTORS = 16
# Expected false detections in a revolution; the profile's radar learns them, but a scene needs a
# number.
CLUTTER = {"approach.clutter_rate": 10.0}
# Changes of the profile for a cloud per sector, and for estimates at each of them.
BY_SECTORS = {"approach.sectors": SECTORS}
AT_EVERY_SECTOR = {**BY_SECTORS, "estimates_period_s": 0.0}
# Number of revolutions after which all aircraft are tracked, more than the profile's lag.
SETTLING = 6
START_NS = 1000 * 10**9
# Largest distance of the aircraft from the radar half-way through, metres, within its range.
FIELD_RADIUS = 90e3
# Metres per second; radians per second and seconds of a turn by a right angle, which every third
# aircraft begins half-way through.
SPEED, TURN_RATE = (110.0, 250.0), np.radians(1.5)
TURN_S = 0.5 * np.pi / TURN_RATE
# Not used by the profile's radar, whose detection probability is given.
SNR_DB = 30.0


def configuration(changes: Mapping[str, Any]) -> TrackerConfig:
    """Return the configuration of the profile with some parameters changed."""
    values = sections.read(resources.find(PROFILE)).values(TRACKER)
    return resolve({**values, **CLUTTER, **changes})


def scene(revolutions: int, config: TrackerConfig, seed: int, aircraft: int = AIRCRAFT) -> Scenario:
    """Return aircraft around the radar that all exist from the first revolution to the last.

    Half-way through, they are spread evenly over a circle. The seed is that of the speeds and
    headings.
    """
    rng = np.random.default_rng(seed)
    rotation_s = config.radars[0].rotation_s
    half_s = 0.5 * revolutions * rotation_s
    return Scenario(
        start_ns=START_NS,
        interval_s=rotation_s,
        scans=revolutions + 1,
        targets=tuple(_aircraft(number, aircraft, half_s, rng) for number in range(aircraft)),
        radars=polar_radars(config.model.radars),
    )


def _aircraft(number: int, count: int, half_s: float, rng: np.random.Generator) -> Flight:
    speed, heading = rng.uniform(*SPEED), rng.uniform(-np.pi, np.pi)
    velocity = speed * np.array([np.cos(heading), np.sin(heading)])
    radius = FIELD_RADIUS * np.sqrt((number + 0.5) / count)
    bearing = GOLDEN_ANGLE * number
    start = radius * np.array([np.cos(bearing), np.sin(bearing)]) - half_s * velocity
    legs = [Leg(2.0 * half_s)]
    if number % 3 == 0:
        turn_s = min(TURN_S, 0.5 * half_s)
        legs = [Leg(half_s), Leg(turn_s, float(rng.choice([-1, 1]) * TURN_RATE))]
        legs.append(Leg(half_s - turn_s))
    return Flight(
        class_id=0,
        snr=snr_from_db(SNR_DB),
        start_s=0.0,
        position=(float(start[0]), float(start[1])),
        velocity=(float(velocity[0]), float(velocity[1])),
        legs=tuple(legs),
    )
