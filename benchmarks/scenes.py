"""Scenes of any number of targets, the tracker's configuration for them, and its start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.simulation.scenario import Scenario, paper_scenario, truth_at
from phd_jdtc_ros.simulation.targets import TargetScript

# Targets are within this distance of (0, 0), metres; both radars cover all of it.
FIELD_RADIUS = 13e3
# Number of targets above which the field grows with it, so that the density stays the same.
DENSEST = 200
SPEED = 57.0
SNR_DB = (45.0, 25.0)
# Standard deviations of a tracking filter's density of a target: m, m/s, rad/s.
POSITION_STD, VELOCITY_STD, TURN_RATE_STD = 100.0, 8.0, 1e-3
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def configuration(
    targets: int, accuracy: str = "normal", clutter: float | None = None
) -> TrackerConfig:
    """Return the reference configuration with matching radars.

    Without `clutter`, the expected false detections per radar and scan, they are half as many as
    targets: 200 targets then give 300 detections per radar. In a larger field the radars' ranges
    grow, and the azimuth's standard deviation falls so that the error at the edge stays the same in
    metres. All scenes of at least `DENSEST` targets are thus equally ambiguous.
    """
    known = from_arguments.profile(from_arguments.REFERENCE)
    usual, scale = resolve(known), _scale(targets)
    radars = {
        f"{radar.name}.{name}": value
        for radar in usual.inputs
        for name, value in {
            "clutter_rate": targets / 2 if clutter is None else clutter,
            "clutter_max_range": scale * float(usual.values[f"{radar.name}.clutter_max_range"]),
            "max_range": scale * float(usual.values[f"{radar.name}.max_range"]),
            "azimuth_std_deg": float(usual.values[f"{radar.name}.azimuth_std_deg"]) / scale,
        }.items()
    }
    return resolve({**known, "accuracy": accuracy, **radars})


def _scale(targets: int) -> float:
    """Return the radius of the field of a number of targets, in radii of the reference field."""
    return float(np.sqrt(max(targets / DENSEST, 1.0)))


def crowd(targets: int, scans: int, config: TrackerConfig, seed: int) -> Scenario:
    """Return targets of both classes, spread evenly over the radars' field, that fly straight.

    Every target exists in all scans; half-way through, the targets form the pattern. The seed is
    that of the headings.
    """
    rng = np.random.default_rng(seed)
    scene = paper_scenario(polar_radars(config.model.radars))
    heading = rng.uniform(-np.pi, np.pi, targets)
    # A sunflower's pattern: evenly spread, and no two targets at the same bearing.
    radius = _scale(targets) * FIELD_RADIUS * np.sqrt((np.arange(targets) + 0.5) / targets)
    bearing = GOLDEN_ANGLE * np.arange(targets)
    velocity = SPEED * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    middle = radius[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    start = middle - velocity * 0.5 * scans * scene.interval_s
    scripts = tuple(
        TargetScript(
            class_id=number % 2,
            snr=snr_from_db(SNR_DB[number % 2]),
            position=(float(start[number, 0]), float(start[number, 1])),
            velocity=(float(velocity[number, 0]), float(velocity[number, 1])),
            first_scan=0,
            last_scan=scans - 1,
        )
        for number in range(targets)
    )
    return replace(scene, scans=scans, targets=scripts)


def mixture(scene: Scenario, config: TrackerConfig) -> Mixture:
    """Return the set of a filter that tracks all targets, one interval before the scene begins.

    Every target exists and has one hypothesis.
    """
    before, dynamics = truth_at(scene, 0), Dynamics(config.model)
    space = config.model.modes.space
    supported, count = dynamics.supported, len(before.state)
    # The engine has more axes than the plane.
    size = supported.shape[1]
    std, state = np.zeros(size), np.zeros((count, size))
    state[:, : len(space)] = _earlier(before, scene, config)
    std[list(space.position)], std[list(space.velocity)] = POSITION_STD, VELOCITY_STD
    std[space.turn_rate] = TURN_RATE_STD
    covariance = supported[:, :, None] * np.diag(std**2)
    # Ascending labels, negative because those of births count from 0.
    return Mixture(
        np.arange(-count, 0),
        dynamics.birth_weight[before.class_id],
        state[:, None] * supported,
        np.broadcast_to(covariance, (count, *covariance.shape)),
        dynamics.unknown_snr(count),
    )


def _earlier(truth: Truth, scene: Scenario, config: TrackerConfig) -> FloatArray:
    """Return the targets' states an interval earlier, shape (T, D)."""
    space = config.model.modes.space
    state: FloatArray = truth.state.copy()
    state[:, list(space.position)] -= scene.interval_s * state[:, list(space.velocity)]
    return state
