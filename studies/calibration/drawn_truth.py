"""Runs whose targets and detections are drawn from a tracker's own model.

A Bayesian filter is calibrated on such runs if its approximations are harmless: nothing else
differs between the truth and its model. Scripted targets cannot show this, because they start at
the mean of their birth and fly without process noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.targets import birth, motion
from phd_jdtc_ros.core.types import Scan, Truth
from phd_jdtc_ros.simulation.simulate import detect

START_NS = 1_000_000_000_000


class Targets(NamedTuple):
    """The targets that exist at one time."""

    number: IntArray  # From 1, in the order of birth, (T,)
    state: FloatArray  # World frame, (T, D)
    mode: IntArray  # Flat mode of class and motion, (T,)
    log_snr: FloatArray  # ln(1 + SNR), (T,)


def drawn_run(
    model: TrackerModel, scans: int, rng: np.random.Generator
) -> list[tuple[Truth, Scan]]:
    """Return truth and detections of consecutive scans, one nominal interval apart.

    The model has births at places, and no spawned targets; its amplitude model draws the SNR.
    """
    modes, radars = model.modes, polar_radars(model.radars)
    none = np.zeros(0, dtype=np.int64)
    targets = Targets(none, np.zeros((0, len(modes.space))), none, np.zeros(0))
    born, run = 0, []
    for index in range(scans):
        targets = _joined([_survivors(targets, model, rng), *_born(model, born, rng)])
        born = max([born, *targets.number.tolist()])
        stamp_ns = START_NS + round(index * modes.interval_s * 1e9)
        truth = Truth(stamp_ns, targets.state, targets.number, modes.class_of[targets.mode])
        snr = np.expm1(targets.log_snr)
        found = tuple(detect(truth, snr, radar, rng)[0] for radar in radars)
        run.append((truth, Scan(stamp_ns, found)))
    return run


def _survivors(targets: Targets, model: TrackerModel, rng: np.random.Generator) -> Targets:
    """Return the targets that survive an interval, after their changes of mode and their motion."""
    modes, dt = model.modes, model.modes.interval_s
    lives = rng.random(len(targets.mode)) < modes.survival(dt)[targets.mode]
    state, mode, log_snr = targets.state[lives], targets.mode[lives], targets.log_snr[lives]
    reached = modes.transition(dt).cumsum(axis=1)[mode]
    mode = np.minimum((rng.random((len(mode), 1)) > reached).sum(axis=1), len(modes) - 1)
    moved = np.zeros_like(state)
    for own, law in enumerate(modes.motions):
        moved[mode == own] = motion.sample(law, state[mode == own], dt, rng)
    log_snr = model.amplitudes.diffuse(log_snr, mode, modes, dt, rng)
    return Targets(targets.number[lives], moved, mode, log_snr)


def _born(model: TrackerModel, before: int, rng: np.random.Generator) -> list[Targets]:
    """Return the targets that are born in an interval, each numbered after `before` others."""
    found: list[Targets] = []
    for term in model.births:
        for _ in range(rng.poisson(term.rate.sum())):
            state, mode = birth.sample(term, model.modes, 1, rng)
            log_snr = model.amplitudes.draw(mode, model.modes, rng)
            found.append(Targets(np.array([before + len(found) + 1]), state, mode, log_snr))
    return found


def _joined(parts: Sequence[Targets]) -> Targets:
    return Targets(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
