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
from phd_jdtc_ros.core.models.amplitude_model import Memory
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
    log_snr: FloatArray  # Of each target, ln(1 + SNR), (T,)


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
    log_snr = diffused_snr(log_snr, mode, model, dt, rng)
    return Targets(targets.number[lives], moved, mode, log_snr)


def _born(model: TrackerModel, before: int, rng: np.random.Generator) -> list[Targets]:
    """Return the targets that are born in an interval, each numbered after `before` others."""
    found: list[Targets] = []
    for term in model.births:
        for _ in range(rng.poisson(term.rate.sum())):
            state, mode = birth.sample(term, model.modes, 1, rng)
            log_snr = drawn_snr(mode, model, rng)
            found.append(Targets(np.array([before + len(found) + 1]), state, mode, log_snr))
    return found


def drawn_snr(mode: IntArray, model: TrackerModel, rng: np.random.Generator) -> FloatArray:
    """Return ln(1 + SNR) of new targets, (N,): uniform over their classes' bands, 0 if not kept."""
    if not isinstance(model.amplitudes, Memory):
        return np.zeros(len(mode))
    low, high = _band_edges(mode, model)
    return low + (high - low) * rng.random(len(mode))


def diffused_snr(
    log_snr: FloatArray, mode: IntArray, model: TrackerModel, dt: float, rng: np.random.Generator
) -> FloatArray:
    """Return ln(1 + SNR) of targets `dt` seconds later, (N,), reflected into their bands."""
    if not isinstance(model.amplitudes, Memory):
        return log_snr
    low, high = _band_edges(mode, model)
    step = model.amplitudes.jitter * np.sqrt(dt / model.modes.interval_s)
    stepped = log_snr + step * rng.standard_normal(len(log_snr))
    stepped = np.where(stepped < low, 2.0 * low - stepped, stepped)
    stepped = np.where(stepped > high, 2.0 * high - stepped, stepped)
    inside: FloatArray = np.clip(stepped, low, high)
    return inside


def _band_edges(mode: IntArray, model: TrackerModel) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest ln(1 + SNR) of each mode's class, (N,)."""
    bands = np.log1p([own.snr_band for own in model.modes.classes])[model.modes.class_of[mode]]
    return bands[:, 0], bands[:, 1]


def _joined(parts: Sequence[Targets]) -> Targets:
    return Targets(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
