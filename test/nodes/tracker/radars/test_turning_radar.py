"""A live tracker and a radar that turns, over DDS."""

from dataclasses import replace

import numpy as np
import pytest
from live_and_offline import answered, started
from sensor_msgs.msg import PointCloud2

from msg_adapters.incoming import detections
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import flatten
from phd_jdtc_ros.core.intake.sectors import coverage_of
from phd_jdtc_ros.core.types import FULL_TURN, Detections

START_NS = 1_700_000_000 * 10**9
ROTATION_S, REVOLUTIONS = 4.0, 6
# East, north and velocities at the start; two aircraft far apart.
AIRCRAFT = np.array([[20e3, 5e3, -200.0, 0.0], [-12e3, -15e3, 100.0, 150.0]])
CLUTTER = 12

PARAMETERS = {
    "sensors": ["tower"],
    "interval_s": ROTATION_S,
    "lag_s": 4.0,
    "classes": ["aircraft"],
    "motions": ["cv"],
    "births": [],
    "detection_births": {"rates": [0.1], "std": [150.0]},
    "spawn": {"rate": 0.0},
    "aircraft": {"motions": ["cv"], "mode_transition": [1.0], "snr_band_db": [10.0, 30.0]},
    "cv": {"noise_density": 5.0},
    "tower": {
        "topic": "/tower/plots",
        "fields": {"amplitude": "", "time": "time", "sector": "sector"},
        "units.azimuth_convention": "compass_cw",
        "rotation_s": ROTATION_S,
        "sectors": 16,
        "detection_probability": 0.95,
        "range_std": 30.0,
        "azimuth_std_deg": 0.1,
        "max_range": 40e3,
        "clutter_rate": float(CLUTTER),
        "clutter_max_range": 40e3,
    },
}


def passed(world, revolution):
    """Return the azimuths of places, and when an antenna that begins north passes them."""
    azimuth = np.arctan2(world[:, 1], world[:, 0])
    return azimuth, ROTATION_S * (revolution + np.mod(np.pi / 2 - azimuth, FULL_TURN) / FULL_TURN)


def plots(revolution, clutter, rng):
    """Return ranges, azimuths and times (s since the start) of a revolution's plots, clockwise."""
    radius, angle = rng.uniform(5e3, 38e3, clutter), rng.uniform(0.0, FULL_TURN, clutter)
    false = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    _, time_s = passed(AIRCRAFT[:, :2] + AIRCRAFT[:, 2:] * revolution * ROTATION_S, revolution)
    world = np.concatenate([AIRCRAFT[:, :2] + AIRCRAFT[:, 2:] * time_s[:, None], false])
    azimuth, time_s = passed(world, revolution)
    distance = np.hypot(*world.T) + 30.0 * rng.standard_normal(len(world))
    return distance, azimuth + np.radians(0.1) * rng.standard_normal(len(azimuth)), time_s


def clouds(config, per_revolution, clutter=CLUTTER):
    """Return the clouds as the radar's driver would publish them, each at the end of its part."""
    rng, radar, sent = np.random.default_rng(4), config.inputs[0], []
    for revolution in range(REVOLUTIONS):
        distance, azimuth, time_s = plots(revolution, clutter, rng)
        for part in range(per_revolution):
            end_s = ROTATION_S * (revolution + (part + 1) / per_revolution)
            inside = (time_s >= end_s - ROTATION_S / per_revolution) & (time_s < end_s)
            measurement = np.stack([distance[inside], azimuth[inside]], axis=1)
            found = Detections(measurement, None, time_s[inside] - end_s)
            if radar.fields.sector:
                found = replace(
                    found, coverage=coverage_of(part, radar.sectors, radar.units.compass)
                )
            stamp_ns = START_NS + round(end_s * 1e9)
            sent.append(detections.to_msg(found, stamp_ns, radar.frame, radar))
    return sent


@pytest.fixture
def tracker(processes, peer, tmp_path):
    """Return a function that starts a tracker.

    It returns the configuration, the radar's publisher, the tracker's estimates and its log.
    """

    def start(**changes):
        given, topic = {**dict(flatten(PARAMETERS)), **changes}, "/tower/plots"
        outputs, found, process = started(processes, peer, tmp_path, given, {topic: PointCloud2})
        return resolve(given), outputs[topic], found, process.log

    return start


def test_a_revolution_that_is_not_configured_is_found_and_reported(tracker, peer):
    layout = {"tower.sectors": 0, "tower.rotation_s": 0.0, "tower.fields.sector": ""}
    config, output, found, log = tracker(**layout, **{"tower.clutter_rate": 150.0})
    answered(peer, output, found, clouds(config, 16, clutter=150)[:40])
    assert peer.spin_until(lambda: "the estimated time of a revolution is " in log.read_text())
