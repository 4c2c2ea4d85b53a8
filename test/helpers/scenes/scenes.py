"""Small models and runs that several test modules share."""

from dataclasses import replace

import inner
import numpy as np

from phd_jdtc_ros.core.types import Detections
from phd_jdtc_ros.simulation.scenario import paper_scenario

SMALL_BUDGET = {
    "particles": [200, 64],
    "budget.least": 20,
    "spawning.particles_per_target": 20,
}
# The motion that the distances and numbers of rows in these scenes are made for.
NOISE = {"cv.noise_density": 1.0, "ct.turn_noise_density": 1e-5}
MODES = {f"class_{index}.mode_transition": [0.8, 0.2, 0.2, 0.8] for index in (0, 1)}
# One class, one motion: the general mode is then a plain PHD.
PLAIN = {
    "sensors": ["radar"],
    "classes": ["target"],
    "motions": ["cv"],
    "births": ["start"],
    "target.snr_band_db": [30.0, 50.0],
    "target.motions": ["cv"],
    "target.mode_transition": [1.0],
    "start.position": [8e3, 6e3],
    "start.rates": [0.01],
    "cv.noise_density": 1.0,
}
TARGETS = np.array([[6e3, 8e3], [6.6e3, 8.2e3], [-9e3, 0.0]])


def small(given=None):
    """Return the reference configuration with few particles, changed by `given`."""
    given = given or {}
    noise = {} if "motions" in given else NOISE
    modes = {} if {"motions", "classes"} & given.keys() else MODES
    return inner.resolve({**SMALL_BUDGET, **noise, **modes, **given})


def plain(given=None):
    """Return a configuration of one radar, one class and one motion, changed by `given`."""
    return inner.resolve({**SMALL_BUDGET, **PLAIN, **(given or {})})


def gaussian_cloud(rng, count, mean, std):
    """Return (count, 5) states about `mean`."""
    return np.asarray(mean) + np.asarray(std) * rng.standard_normal((count, 5))


def no_detections():
    return Detections(np.zeros((0, 2)), np.zeros(0))


def reference_scenario():
    """Return the paper's scene: two parallel targets, one crossing both, one crossing late."""
    return paper_scenario(inner.resolve({}).model.radars)


def short_scenario(scans, clutter_rate=5.0):
    """Return the first scans of the reference scene, with less clutter."""
    scenario = reference_scenario()
    radars = tuple(replace(radar, clutter_rate=clutter_rate) for radar in scenario.radars)
    return replace(scenario, scans=scans, radars=radars)


def seen_with(model, probability):
    """Return a model with radars that detect with a given probability."""
    given = {"ranges": (0.0,), "probabilities": (probability,)}
    radars = [replace(r, visibility=replace(r.visibility, **given)) for r in model.radars]
    return replace(model, radars=tuple(radars))
