"""Small models and particle sets for the tests of `core.phd`."""

import numpy as np
from scenes import TARGETS
from scenes import plain as plain_scene
from scenes import small as small_scene
from scipy import sparse

from phd_jdtc_ros.core.phd.particles import Particles
from phd_jdtc_ros.core.state_space import OMEGA


def small(given=None):
    """Return the reference configuration of a PHD filter with few particles."""
    return small_scene({"engine": "phd", **(given or {})})


def plain(given=None):
    """Return a PHD filter's configuration of one radar, one class and one motion."""
    return plain_scene({"engine": "phd", **(given or {})})


def particles(state, weight, mode=None, origin=None, components=None, multiplicity=None):
    """Return particles; `weight` is the part that no detection explains."""
    count = len(state)
    none = np.zeros(count, dtype=int)
    return Particles(
        state=np.asarray(state, dtype=float),
        mode=none if mode is None else mode,
        origin=none if origin is None else origin,
        parent=np.full(count, -1),
        multiplicity=none + 1 if multiplicity is None else multiplicity,
        poisson=np.asarray(weight, dtype=float),
        components=sparse.csr_array(np.zeros((count, 0)) if components is None else components),
    )


def scattered(seed=0, count=300, mass=2.0):
    """Return particles about three places, one on the azimuth's cut, in all modes."""
    rng = np.random.default_rng(seed)
    state = np.zeros((count, 5))
    state[:, [0, 2]] = TARGETS[rng.integers(0, 3, count)] + rng.normal(0.0, 300.0, (count, 2))
    state[:, [1, 3]] = rng.normal(0.0, 30.0, (count, 2))
    mode = rng.integers(0, 4, count)
    state[:, OMEGA] = np.where(mode % 2 == 1, rng.normal(0.0, 1e-2, count), 0.0)
    weight = rng.exponential(1.0, count)
    weight *= mass / weight.sum()
    return particles(state, weight, mode=mode, origin=rng.integers(0, 3, count))
