"""New targets: births at known places, with positions by Sobol points, and spawning.

Sobol points fill the unit cube more evenly than independent points do.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtri

from ..arrays import FloatArray, IntArray, ReadOnly, read_only
from .modes import ModeSpace


@dataclass(frozen=True)
class SpawnModel(ReadOnly):
    """The spawn intensity beta.

    Sec. V, beta_{k|k-1}. Deviation: the printed kernel is centred on x_{k-1}, one interval behind
    the parent (340 m for the scenario's targets). Here it is centred on F x_{k-1}, with F of the
    spawned target's mode.
    """

    rate: float  # Expected spawned targets per target and nominal interval, lambda_beta
    # From the parent's flat mode to that of the spawned target, (O, O); rows sum to one. It is the
    # class matrix b times the mode matrix; unlike survival, it can change the class.
    transition: FloatArray
    # Standard deviations of the spawned state about its predicted parent, in the world frame, (D,).
    std: FloatArray
    # Number of particles for all targets that one target spawns.
    particles_per_target: int


BITS = 30
# A primitive polynomial over GF(2) for each axis, as the bits of its coefficients, and the odd
# numbers with which its recurrence begins. They are the first of scipy.stats.qmc, whose import
# would take a third of the start of a tracker.
AXES: tuple[tuple[int, tuple[int, ...]], ...] = (
    (1, ()),
    (3, (1,)),
    (7, (1, 3)),
    (11, (1, 3, 1)),
    (13, (1, 1, 1)),
    (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)),
    (37, (1, 1, 5, 5, 17)),
)


@lru_cache(maxsize=8)
def sobol_points(dimension: int, count: int) -> FloatArray:
    """Return the first points of the sequence, (count, dimension), in the order of the Gray code.

    They are unscrambled, so that the first is the origin, and in [0, 1). Raise `ValueError` if the
    count is not a power of two, at most 2^30, or if there are more axes than `AXES` has.

    References
    ----------
    Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections", SIAM
    Journal on Scientific Computing 30(5), 2008.
    """
    if count < 1 or count & (count - 1) or count > 2**BITS:
        raise ValueError(f"count: {count} given, must be a power of two, at most 2^{BITS}")
    if not 1 <= dimension <= len(AXES):
        raise ValueError(f"dimension: {dimension} given, must be from 1 to {len(AXES)}")
    doublings = count.bit_length() - 1
    directions = [
        _directions(polynomial, initial, doublings) for polynomial, initial in AXES[:dimension]
    ]
    points = np.zeros((count, dimension), dtype=np.int64)
    for bit, direction in enumerate(zip(*directions, strict=True)):
        # The Gray code of the next 2^bit numbers is that of the numbers before in reverse order,
        # with one bit more.
        half = 1 << bit
        points[half : 2 * half] = points[:half][::-1] ^ np.array(direction)
    scaled: FloatArray = read_only(points * 2.0**-BITS)
    return scaled


def _directions(polynomial: int, initial: tuple[int, ...], count: int) -> list[int]:
    """Return what each bit of a Gray code adds to a coordinate, in units of 2^-BITS."""
    degree = len(initial)
    odd = list(initial)
    while len(odd) < count:
        following = odd[-degree] if degree else 1
        for back in range(1, degree + 1):
            if polynomial >> (degree - back) & 1:
                following ^= odd[-back] << back
        odd.append(following)
    return [value << (BITS - 1 - bit) for bit, value in enumerate(odd[:count])]


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
