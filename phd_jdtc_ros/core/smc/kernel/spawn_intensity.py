"""The intensity of spawned targets at the rows of a later particle set."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray, add_by_row
from ...models.tracker_model import TrackerModel
from ...targets.motion import MotionModel
from ..particle_set import ParticleSet
from .transition_density import TransitionDensity

# Bound on the share of mu that spawned mass beyond the search radius adds; it is a tenth of the
# gate's own error. For most rows the radius is 5 or 6 sigma, which saves a quarter of the tests.
SPAWN_TOLERANCE = 1e-5
# Largest number of bins of the histogram that bounds the spawned mass; fewer loosen the bound.
MAX_BINS = 4096


def spawn_intensity(
    mu: FloatArray,
    earlier: ParticleSet,
    later: ParticleSet,
    model: TrackerModel,
    dt: float,
    successor: dict[MotionModel, FloatArray],
    gate: float,
) -> FloatArray:
    """Return sum_s w(s) beta(q | s) for every later row, shape (N_{t+1},).

    `mu` is the intensity of survivors and births at these rows, `successor` has the noise-free
    successors of the earlier rows, and `gate` is the largest search radius, in standard deviations
    of the spawned state.

    The search radius r of a row is chosen so that the spawned intensity beyond it is a small share
    of `mu`. That intensity is bounded as if all mass within the gate were at the distance r.
    """
    spawn, modes = model.spawn, model.modes
    noise = {motion: np.diag(spawn.std[list(motion.support)] ** 2) for motion in successor}
    rate = spawn.rate * dt / modes.interval_s
    scale = rate * earlier.weight
    kernel = TransitionDensity.of_noise(
        noise, modes, spawn.transition, successor, earlier.mode, scale
    )
    bound = (kernel.peak * spawn.transition.max(axis=0))[later.mode]
    bound *= _mass_bound(later.state, kernel, gate * spawn.std, modes.space.position)
    tiny = np.finfo(float).tiny
    log_share = np.log(np.maximum(bound, tiny)) - np.log(np.maximum(mu, tiny))
    square = np.minimum(2.0 * (log_share - np.log(SPAWN_TOLERANCE)), gate**2)
    rows = np.flatnonzero(square > 0.0)
    radius = np.sqrt(square[rows])
    total = np.zeros(len(rows))
    for row, _, value in kernel.gated_pairs(later, rows, radius):
        add_by_row(total, row, value)
    intensity = np.zeros(len(later))
    intensity[rows] = total
    return intensity


def _mass_bound(
    state: FloatArray, kernel: TransitionDensity, reach: FloatArray, axes: tuple[int, ...]
) -> FloatArray:
    """Return an upper bound of the scaled mass with a successor within `reach` of each state, (N,).

    Bins along one axis are at least as wide as the reach, so that three of them contain all of this
    mass. The bound is the smallest over the axes.
    """
    bound = np.full(len(state), np.inf)
    for axis in axes:
        coordinate = np.array([successor[:, axis] for successor in kernel.successor.values()])
        low, high = coordinate.min(), coordinate.max()
        width = max(reach[axis], (high - low) / MAX_BINS)
        bins = int((high - low) / width) + 1
        mass = np.zeros(bins + 4)
        for successor_bin in ((coordinate - low) / width).astype(np.int64):
            mass[2:-2] += np.bincount(successor_bin, kernel.scale, minlength=bins)
        state_bin = np.floor((state[:, axis] - low) / width).clip(-1, bins).astype(np.int64) + 2
        bound = np.minimum(bound, (mass[:-2] + mass[1:-1] + mass[2:])[state_bin - 1])
    return bound
