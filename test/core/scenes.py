"""Small models, sets and runs that several test modules share."""

from dataclasses import replace

import numpy as np
from scipy import sparse

from phd_jdtc_ros.core import config
from phd_jdtc_ros.core.simulation import paper_scenario
from phd_jdtc_ros.core.types import Detections, ParticlePHD

SMALL_BUDGET = {
    "particles_per_target": 200,
    "least_particles": 20,
    "particles_per_birth": 64,
    "spawn.particles_per_target": 20,
}
# One class, one motion: the general mode is then a plain PHD.
PLAIN = {
    "radars": ["radar"],
    "classes": ["target"],
    "motions": ["cv"],
    "births": ["start"],
    "target.snr_band_db": [30.0, 50.0],
    "target.motions": ["cv"],
    "target.mode_transition": [1.0],
    "spawn.class_transition": [],
    "spawn.mode_transition": [],
    "start.position": [8e3, 6e3],
    "start.rates": [0.01],
}


def small(given=None):
    """Return the reference configuration with few particles, changed by `given`."""
    return config.resolve({**SMALL_BUDGET, **(given or {})})


def plain(given=None):
    """Return a configuration of one radar, one class and one motion, changed by `given`."""
    return config.resolve({**SMALL_BUDGET, **PLAIN, **(given or {})})


def intensity(
    state,
    weight,
    mode=None,
    origin=None,
    components=None,
    multiplicity=None,
    label=None,
):
    """Return a particle intensity; `weight` is the part that no detection explains."""
    count = len(state)
    parts = sparse.csr_array(np.zeros((count, 0)) if components is None else components)
    return ParticlePHD(
        state=np.asarray(state, dtype=float),
        mode=np.zeros(count, dtype=int) if mode is None else mode,
        origin=np.zeros(count, dtype=int) if origin is None else origin,
        parent=np.full(count, -1),
        multiplicity=np.ones(count, dtype=int) if multiplicity is None else multiplicity,
        poisson=np.asarray(weight, dtype=float),
        components=parts,
        label=np.full(parts.shape[1], -1) if label is None else label,
        memory=np.zeros(count),
    )


def gaussian_cloud(rng, count, mean, std):
    """Return (count, 5) states about `mean`."""
    return np.asarray(mean) + np.asarray(std) * rng.standard_normal((count, 5))


def no_detections():
    return Detections(np.zeros((0, 2)), np.zeros(0))


def reference_scenario():
    """Return the paper's scene: two parallel targets, one crossing both, one crossing late."""
    return paper_scenario(config.resolve({}).model.radars)


def short_scenario(scans, clutter_rate=5.0):
    """Return the first scans of the reference scene, with less clutter."""
    scenario = reference_scenario()
    radars = tuple(replace(radar, clutter_rate=clutter_rate) for radar in scenario.radars)
    return replace(scenario, scans=scans, radars=radars)
