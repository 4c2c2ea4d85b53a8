# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scenes of any number of targets, and the tracker's configuration for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import sparse

from phd_jdtc_ros.core.arrays import IntArray
from phd_jdtc_ros.core.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.core.models.amplitude_density import snr_from_db
from phd_jdtc_ros.core.simulation.scenario import (
    Scenario,
    TargetScript,
    Truth,
    paper_scenario,
    truth_at,
)
from phd_jdtc_ros.core.smc.particle_set import ParticleSet

# Targets are within this distance of (0, 0), metres; both radars cover all of it.
FIELD_RADIUS = 13e3
SPEED = 57.0
SNR_DB = (45.0, 25.0)
# Standard deviations of a tracking filter's particles about a target: m, m/s, rad/s.
POSITION_STD, VELOCITY_STD, TURN_RATE_STD = 100.0, 8.0, 1e-3
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def configuration(targets: int, per_target: int, corrector: str = "bernoulli") -> TrackerConfig:
    """Return the reference configuration with `per_target` particles and matching clutter.

    There are half as many false detections as targets: 200 targets give 300 detections per radar.
    """
    return resolve(
        {
            "corrector": corrector,
            "particles_per_target": per_target,
            # In the default's proportion to the particles per target.
            "least_particles": max(per_target // 5, 1),
            "radar_1.clutter_rate": targets / 2,
            "radar_2.clutter_rate": targets / 2,
        }
    )


def crowd(targets: int, scans: int, config: TrackerConfig, seed: int) -> Scenario:
    """Return targets of both classes, spread evenly over the radars' field, that fly straight.

    Parameters
    ----------
    targets : int
    scans : int
        Every target exists in all of them; half-way through, the targets form the pattern.
    config : TrackerConfig
        For the radars.
    seed : int
        Of the headings.
    """
    rng = np.random.default_rng(seed)
    scene = paper_scenario(config.model.radars)
    heading = rng.uniform(-np.pi, np.pi, targets)
    # As a sunflower's seeds: evenly spread, and no two at the same bearing.
    radius = FIELD_RADIUS * np.sqrt((np.arange(targets) + 0.5) / targets)
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


def clouds(scene: Scenario, config: TrackerConfig, rng: np.random.Generator) -> ParticleSet:
    """Return the set of a filter that tracks all targets, one interval before the scene begins.

    Every target has its own origin, and ``particles_per_target`` rows with a total mass of one,
    about half of them in each motion of its class.
    """
    before: Truth = truth_at(scene, 0)
    count = config.values["particles_per_target"]
    modes = config.model.modes
    target = np.repeat(np.arange(len(before.state)), count)
    state = before.state[target].copy()
    space = modes.space
    position, velocity, turn_rate = list(space.position), list(space.velocity), space.turn_rate
    state[:, position] -= scene.interval_s * state[:, velocity]
    state[:, position] += POSITION_STD * rng.standard_normal((len(target), 2))
    state[:, velocity] += VELOCITY_STD * rng.standard_normal((len(target), 2))
    mode = _modes_of(before, config, target, rng)
    turning = np.array([turn_rate in motion.support for motion in modes.motions])[mode]
    state[:, turn_rate] = np.where(turning, TURN_RATE_STD * rng.standard_normal(len(target)), 0.0)
    return ParticleSet(
        state=state,
        mode=mode,
        # Below those of births, which are counted from 0.
        origin=-1 - target,
        parent=np.full(len(target), -1),
        multiplicity=np.ones(len(target), dtype=np.int64),
        poisson=np.full(len(target), 1.0 / count),
        components=sparse.csr_array((len(target), 0)),
        label=np.zeros(0, dtype=np.int64),
        log_snr=config.model.amplitudes.born(mode, modes, rng),
    )


def _modes_of(
    truth: Truth, config: TrackerConfig, target: IntArray, rng: np.random.Generator
) -> IntArray:
    """Return a flat mode of each row's class, drawn uniformly."""
    class_of = config.model.modes.class_of
    first = np.searchsorted(class_of, truth.class_id[target])
    motions = np.bincount(class_of)[truth.class_id[target]]
    return first + rng.integers(0, motions)
