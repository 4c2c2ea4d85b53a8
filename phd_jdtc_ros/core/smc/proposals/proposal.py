"""Importance proposal of the process noise, conditioned on the detections.

Hardly any particle drawn from the prior explains a detection of a precise radar. Where the process
noise is not small against a detection's standard deviations, part of the particles therefore draw
their noise conditioned on the detection. Importance weights keep the predicted density unchanged.

Let m be a particle's position without noise, Q the covariance of the noise in position, R_j the
covariance of detection z_j, and S_j = Q + R_j. The proposal is a mixture of the process noise, with
share a, and of the noise given each detection, with shares (1 - a) N(z_j; m, S_j) / sum_i N(z_i; m,
S_i). By Bayes' rule its density at the position x, relative to the density of the process noise, is
a + (1 - a) sum_j N(z_j; x, R_j) / sum_j N(z_j; m, S_j). The weight is the inverse, at most 1 / a.

References
----------
Doucet, Godsill and Andrieu, "On sequential Monte Carlo sampling methods for Bayesian filtering",
Statistics and Computing 10, 2000, for the optimal importance density; the share of the prior is
the defensive mixture of Hesterberg, Technometrics 37(2), 1995.
"""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, IntArray
from ...targets import motion
from ...targets.motion import MotionModel
from .detections_in_plane import InPlane

# Detections enter the proposal if their larger standard deviation is below this multiple of the
# process noise's.
SHARP = 6.0
# Share of the particles whose noise is drawn from the prior.
BLIND_SHARE = 0.3
# Gate, in standard deviations of the innovation, on the detections in a particle's proposal.
PROPOSAL_GATE_SIGMA = 6.0
# Largest product of particles and detections; beyond it all noise is drawn from the prior.
MAX_PAIRS = 1 << 22


def sample(
    model: MotionModel, state: FloatArray, dt: float, detections: InPlane, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draw the state of every row after `dt` seconds, (N, D); return also the factor on its weight.

    The factors, (N,), are at most 1 / `BLIND_SHARE`, with mean 1. They are 1 for a motion without
    velocity, whose noise is too small to need detections. The detections are those at that time.
    """
    drawn = motion.sample(model, state, dt, rng)
    if not set(model.space.velocity) <= set(model.support):
        return drawn, np.ones(len(state))
    noise = model.noise_covariance(dt)
    position = [model.support.index(axis) for axis in model.space.position]
    sharp = detections.sharper_than(SHARP * float(np.sqrt(noise[position[0], position[0]])))
    if not 0 < len(sharp.position) * len(state) <= MAX_PAIRS:
        return drawn, np.ones(len(state))
    # Covariance of the noise and the position, (M, K, 2), and of the innovation, (M, 2, 2).
    seen_noise = _at_detection_time(noise, sharp, model)
    innovation = sharp.covariance + _at_detection_time(seen_noise.swapaxes(1, 2), sharp, model)
    predictive = _densities(sharp, model.mean(state, dt), model, innovation)
    total = predictive.sum(axis=0)
    guided = np.flatnonzero((total > 0.0) & (rng.random(len(state)) >= BLIND_SHARE))
    chosen = _choose(predictive[:, guided], rng)
    gain = seen_noise @ np.linalg.inv(innovation)
    _condition_on_detections(drawn, guided, chosen, model, gain, sharp, rng)
    explained = _densities(sharp, drawn, model, sharp.covariance, gate=False)
    explained = (explained * (predictive > 0.0)).sum(axis=0)
    is_explained = total > 0.0
    ratio = np.divide(explained, total, out=np.ones(len(state)), where=is_explained)
    return drawn, 1.0 / (BLIND_SHARE + (1.0 - BLIND_SHARE) * ratio)


def _at_detection_time(
    covariance: FloatArray, detections: InPlane, model: MotionModel
) -> FloatArray:
    """Return covariances with the position at each detection's time, for those with the state.

    The last axis of the argument, (..., K), has the motion's support; that of the result,
    (M, ..., 2), has the position.
    """
    position = [model.support.index(axis) for axis in model.space.position]
    velocity = [model.support.index(axis) for axis in model.space.velocity]
    return covariance[..., position] + detections.time_s[:, None, None] * covariance[..., velocity]


def _densities(
    detections: InPlane,
    state: FloatArray,
    model: MotionModel,
    covariance: FloatArray,
    gate: bool = True,
) -> FloatArray:
    """Return N(z_j; x_i, C_j) of every detection and state, zero outside the gate; (M, N)."""
    inverse = np.linalg.inv(covariance)
    # The products are written out by axes, because many 2 x 2 matrix products cost several times as
    # much.
    east, north = (
        detections.position[:, axis, None]
        - state[:, position]
        - np.outer(detections.time_s, state[:, velocity])
        for axis, (position, velocity) in enumerate(
            zip(model.space.position, model.space.velocity, strict=True)
        )
    )
    square = east * (inverse[:, 0, 0, None] * east + 2.0 * inverse[:, 0, 1, None] * north)
    square += inverse[:, 1, 1, None] * north**2
    peak = 1.0 / (2.0 * np.pi * np.sqrt(np.linalg.det(covariance)))
    density: FloatArray = peak[:, None] * np.exp(-0.5 * square)
    return np.where(square <= PROPOSAL_GATE_SIGMA**2, density, 0.0) if gate else density


def _choose(density: FloatArray, rng: np.random.Generator) -> IntArray:
    """Draw a detection for each column in proportion to its density; (M, n) to (n,)."""
    running = np.cumsum(density, axis=0)
    drawn: IntArray = (running < rng.random(density.shape[1]) * running[-1]).sum(axis=0)
    return np.minimum(drawn, len(density) - 1)


def _condition_on_detections(
    drawn: FloatArray,
    rows: IntArray,
    chosen: IntArray,
    model: MotionModel,
    gain: FloatArray,
    detections: InPlane,
    rng: np.random.Generator,
) -> None:
    """Condition the noise of some rows, in place, on the detection drawn for each.

    A draw of the noise plus gain times (detection - position - a draw of the detection's error) is
    a draw of the noise given the detection (Matheron's rule).
    """
    root = np.linalg.cholesky(detections.covariance)
    error = (root[chosen] @ rng.standard_normal((len(rows), 2, 1)))[..., 0]
    state = drawn[rows]
    offset = detections.position[chosen] - state[:, list(model.space.position)] - error
    offset -= detections.time_s[chosen, None] * state[:, list(model.space.velocity)]
    drawn[np.ix_(rows, np.array(model.support))] += (gain[chosen] @ offset[..., None])[..., 0]
