"""A sensor of positions, alone and beside a radar, from recorded messages to estimates.

The target has the tracker's own model of motion, and the reported positions have errors with a
covariance that changes from report to report.
"""

import numpy as np
from bag_content import recorded, write

from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.parameter_files import bag_parameters
from phd_jdtc_ros.report import load

SCANS, INTERVAL_S = 80, 2.0
STAMPS_NS = [round(1e9 * (1000.0 + INTERVAL_S * scan)) for scan in range(SCANS)]
START, NOISE_DENSITY = np.array([[-4000.0, 1000.0], [30.0, -8.0]]), 0.5
WIDTH, CLUTTER, PROBABILITY = 20_000.0, 3.0, 0.9
# Smallest and largest standard deviation of a reported position along an axis, metres.
STDS = (10.0, 40.0)
TRACKER = {
    "interval_s": INTERVAL_S,
    "classes": ["target"],
    "motions": ["cv"],
    "target.motions": ["cv"],
    "target.mode_transition": [1.0],
    "cv.noise_density": NOISE_DENSITY,
    "births": [],
    "detection_births.rates": [0.01],
    "spawn.rate": 0.0,
}
SENSORS = {
    "ais": {
        "kind": "position",
        "position_std": 500.0,  # Far from the deviations of the reports, which count
        "area": [-WIDTH / 2.0, -WIDTH / 2.0, WIDTH / 2.0, WIDTH / 2.0],
        "clutter_rate": CLUTTER,
        "detection_probability": PROBABILITY,
    },
    "radar": {
        "position": [-4000.0, 5000.0],
        "range_std": 30.0,
        "azimuth_std_deg": 0.5,
        "max_range": WIDTH,
        "clutter_max_range": WIDTH,
        "clutter_rate": CLUTTER,
        "detection_probability": PROBABILITY,
        "fields.amplitude": "",
    },
}
# Scans after which the target is confirmed, and its velocity known.
SETTLED = 10


def parameters(sensors):
    of_sensors = {
        f"{name}.{key}": value for name in sensors for key, value in SENSORS[name].items()
    }
    return {**TRACKER, "sensors": sensors, **of_sensors}


def truth(rng):
    """Return the target's positions, (SCANS, 2), with white acceleration."""
    t = INTERVAL_S
    root = np.linalg.cholesky(NOISE_DENSITY * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]))
    state, positions = START, []
    for _ in range(SCANS):
        positions.append(state[0])
        state = np.array([[1.0, t], [0.0, 1.0]]) @ state + root @ rng.standard_normal((2, 2))
    return np.array(positions)


def reports(_, position, rng):
    """Return the report of a position, or none, among false ones; each has its own covariance."""
    found = rng.uniform(-WIDTH / 2.0, WIDTH / 2.0, (rng.poisson(CLUTTER), 2))
    if rng.random() < PROBABILITY:
        found = np.concatenate([[position], found])
    std, correlation = rng.uniform(*STDS, found.shape), rng.uniform(-0.8, 0.8, len(found))
    normal = rng.standard_normal(found.shape)
    normal[:, 1] = correlation * normal[:, 0] + np.sqrt(1.0 - correlation**2) * normal[:, 1]
    return Detections(found + std * normal, None, noise_std=std, noise_correlation=correlation)


def plots(radar, position, rng):
    """Return a radar's detection of a position, or none, among false ones."""
    found = rng.uniform([0.0, -np.pi], [WIDTH, np.pi], (rng.poisson(CLUTTER), 2))
    if rng.random() < PROBABILITY:
        own = radar.linearise(position)[0] + radar.noise_std * rng.standard_normal(2)
        found = np.concatenate([own[None], found])
    return Detections(found, None)


DRAWN = {"ais": reports, "radar": plots}


def tracked(path, sensors):
    """Return the truth, and the estimates of a bag of the sensors' messages."""
    config, positions = resolve(parameters(sensors)), truth(np.random.default_rng(17))
    entries = []
    for own, sensor in zip(config.inputs, config.model.radars, strict=True):
        rng, encode = np.random.default_rng(len(own.name)), reader_of(own).to_cdr
        for stamp_ns, position in zip(STAMPS_NS, positions, strict=True):
            found = DRAWN[own.name](sensor, position, rng)
            entries.append((own.topic, encode(found, stamp_ns, own), stamp_ns))
    entries.sort(key=lambda entry: entry[2])
    bag = write(path / "recorded", [own.topic for own in config.inputs], entries)
    bag_parameters.write(bag / bag_parameters.NAME, config.values)
    out = path / "tracked"
    assert run("track_bag", [str(bag), "--out", str(out)]) == 0
    assert len(load.record(out, config).plots) == len(entries)
    return positions, recorded(out)


def errors(positions, found):
    """Return the root mean square error of positions, and the mean relative to the covariances."""
    settled = list(zip(positions, found, strict=True))[SETTLED:]
    assert [len(estimates) for _, estimates in settled] == [1] * len(settled)
    assert len({estimates.track_id[0] for _, estimates in settled}) == 1
    place = list(found[0].space.position)
    error = np.array([estimates.position[0] - position for position, estimates in settled])
    covariance = np.array([each.covariance[0][np.ix_(place, place)] for _, each in settled])
    relative = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    return np.sqrt(np.square(error).mean()), relative.mean()


def test_positions_are_tracked_alone_and_beside_a_radar(tmp_path):
    measured = np.sqrt(np.square(np.linspace(*STDS)).mean())
    alone, relative = errors(*tracked(tmp_path / "alone", ["ais"]))
    assert alone < 0.7 * measured
    # Chi-square with two degrees of freedom; errors are correlated over some four scans.
    assert 0.5 < relative < 3.5
    beside, relative = errors(*tracked(tmp_path / "beside", ["radar", "ais"]))
    assert beside < 1.1 * alone
    assert 0.5 < relative < 3.5
