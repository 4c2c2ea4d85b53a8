"""The birth intensity: positions, classes and rates of new targets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from ..arrays import FloatArray, IntArray, ReadOnly
from .modes import ModeSpace
from .sobol import sobol_points


@dataclass(frozen=True)
class BirthTerm(ReadOnly):
    """One Gaussian term of the birth intensity.

    Sec. V, gamma_{k,c}. A term has births of all classes, so that its position does not imply the
    class.
    """

    name: str
    mean: FloatArray  # World frame, (D,)
    std: FloatArray  # Standard deviations of the axes, uncorrelated, (D,)
    rate: FloatArray  # Expected births per nominal interval in every flat mode, (O,)


def shift_points(points: FloatArray, shift: FloatArray) -> FloatArray:
    """Return points of the unit cube shifted modulo one, kept off the faces; broadcast shape."""
    shifted: FloatArray = points + shift
    shifted -= np.floor(shifted)
    return np.clip(shifted, 1e-12, 1.0 - 1e-12, out=shifted)


def sample(
    term: BirthTerm, modes: ModeSpace, count: int, rng: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    """Draw quasi-random states, (count, D), and flat modes from one term.

    The count is a power of two. The generator draws the random shift (modulo one) that makes the
    Sobol points unbiased.
    """
    size = len(term.mean)
    uniform = shift_points(sobol_points(size + 1, count), rng.random(size + 1))
    share = np.cumsum(term.rate) / term.rate.sum()
    mode = np.minimum(np.searchsorted(share, uniform[:, 0], side="right"), len(share) - 1)
    state = ndtri(uniform[:, 1:])
    state *= term.std
    state += term.mean
    for index, motion in enumerate(modes.motions):
        outside = [d for d in range(size) if d not in motion.support]
        if outside:
            state[np.ix_(mode == index, outside)] = 0.0
    return state, mode


def intensity(
    terms: tuple[BirthTerm, ...], modes: ModeSpace, state: FloatArray, mode: IntArray
) -> FloatArray:
    """Return gamma(x, o) at every row, over each mode's own support; shape (N,).

    The rate is per nominal interval; the caller scales it.
    """
    supported = np.zeros((len(modes), state.shape[1]), dtype=bool)
    for index, motion in enumerate(modes.motions):
        supported[index, list(motion.support)] = True
    total = np.zeros(len(state))
    # Rows are sorted along one axis, so that a term is evaluated only at rows near it.
    axis = modes.space.position[0]
    east = np.argsort(state[:, axis])
    sorted_east = state[east, axis]
    for term in terms:
        # Standard deviations in any coordinate beyond which a birth term counts as zero.
        gate = 8.0 * term.std
        first, last = sorted_east.searchsorted(
            [term.mean[axis] - gate[axis], term.mean[axis] + gate[axis]]
        )
        about = east[first:last]
        offset = state[about] - term.mean
        # States have no value on the axes that their mode lacks.
        active = supported[mode[about]]
        near = ((np.abs(offset) <= gate) | ~active).all(axis=1)
        in_gate = near & (term.rate[mode[about]] > 0.0)
        about, scaled, active = about[in_gate], offset[in_gate] / term.std, active[in_gate]
        per_axis = 0.5 * scaled**2 + np.log(term.std * np.sqrt(2.0 * np.pi))
        total[about] += term.rate[mode[about]] * np.exp(
            -np.where(active, per_axis, 0.0).sum(axis=1)
        )
    return total
