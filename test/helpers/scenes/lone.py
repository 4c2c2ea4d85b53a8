"""A target alone in the field of one radar, and Gaussian engines with a prior at its start."""

from dataclasses import replace

import inner
import numpy as np

from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.gaussian.dynamics import Dynamics
from phd_jdtc_ros.core.gaussian.entries import Entry, UnsweptRows
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.gaussian.reduction import Branched
from phd_jdtc_ros.core.gaussian.update import GaussianSteps
from phd_jdtc_ros.core.sensors.view import View
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.tracks import track_numbers
from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.core.window.update import Updated, update

START_NS = 10**12
INTERVAL_S = 6.0
GIVEN = {
    "sensors": ["radar"],
    "classes": ["target"],
    "motions": ["cv"],
    "births": [],
    "interval_s": INTERVAL_S,
    "max_gap_scans": 1e5,
    "amplitude": "none",
    # Motions are mixed with every scan, as by a textbook's interacting multiple models.
    "accuracy": "fast",
    "spawn.rate": 0.0,
    "target.motions": ["cv"],
    "target.mode_transition": [1.0],
    "target.survival_probability": 1.0,
    "cv.noise_density": 1.0,
    "radar.position": [500.0, -300.0],
    "radar.yaw_deg": 20.0,
    "radar.clutter_rate": 0.0,
    "radar.detection_probability": 0.999,
    "radar.max_range": 5e4,
}
TWO_MOTIONS = {
    "motions": ["cv", "ct"],
    "target.motions": ["cv", "ct"],
    "target.mode_transition": [0.9, 0.1, 0.25, 0.75],
    "ct.model": "coordinated_turn",
    "ct.noise_density": 2.0,
    "ct.turn_noise_density": 1e-5,
}
# Two classes that move alike and whose amplitudes differ.
BANDS = {
    "classes": ["low", "high"],
    **{
        f"{kind}.{name}": value
        for kind, band in (("low", [6.0, 12.0]), ("high", [14.0, 25.0]))
        for name, value in (
            ("snr_band_db", band),
            ("survival_probability", 1.0),
            ("motions", ["cv", "ct"]),
            ("mode_transition", [0.9, 0.1, 0.25, 0.75]),
        )
    },
}
BIRTHS = {
    "detection_births.rates": [0.05],
    "detection_births.std": [35.0, 2e-3],
    "radar.clutter_rate": 2.0,
}
# Nothing is dropped or merged.
UNREDUCED = {"bounds.hypotheses": 1000, "bounds.least_share": 0.0, "bounds.merge_distance": 0.0}
SIZE = len(PLANAR)
MEAN = np.array([6e3, 40.0, 8e3, -25.0, 0.0])
STD = np.array([300.0, 30.0, 250.0, 35.0, 5e-3])


def lone(given=None):
    """Return a configuration of one radar and no births, changed by `given`."""
    table = {**GIVEN, **(given or {})}
    gone = {"target", "cv"} - {*table["classes"], *table["motions"]}
    kept = {name: value for name, value in table.items() if name.split(".")[0] not in gone}
    return inner.resolve(kept)


def mixture_of(dynamics, targets):
    """Return targets of one hypothesis each, given as (existence, mean, std)."""
    supported = dynamics.supported
    share = np.tensordot(
        np.full(len(dynamics.model.modes), 1.0 / len(dynamics.model.modes)), dynamics.spread, axes=1
    )
    weight = [existence * share for existence, _, _ in targets]
    mean = [mean * supported for _, mean, _ in targets]
    covariance = [
        np.diag(np.square(std)) * supported[:, :, None] * supported[:, None, :]
        for _, _, std in targets
    ]
    snr = dynamics.unknown_snr(len(targets))
    return Mixture(np.arange(len(targets)), weight, mean, covariance, snr)


def started(config, *targets):
    """Return an engine that starts with these targets, (existence, mean, std)."""
    engine = new_engine(config)
    stored = mixture_of(engine.forward.dynamics, targets or [(1.0, MEAN, STD)])
    start_from(engine, START_NS, stored)
    return engine


def start_from(engine, stamp_ns, stored):
    """Use a mixture as the set of an earlier scan of an engine."""
    engine.forward.stamp_ns = stamp_ns
    engine.forward.unswept = [UnsweptRows(Entry(stamp_ns, stored))]


def updated(config, mixture, detections, **more):
    """Return what one radar's detections make of a mixture, and the births; see `learned`."""
    found = learned(config, mixture, detections, **more)
    return found.rows, next(iter(found.newborns), None)


def learned(config, mixture, detections, factors=None, stamp_ns=0, **bounds):
    """Return the hypotheses and factors after one radar's detections; `Updated`.

    Without `factors` nothing has been learned before.
    """
    (radar,), forward = config.model.radars, new_engine(config).forward
    before = Updated(Branched(mixture, np.arange(len(mixture))), factors or forward.factors)
    steps = GaussianSteps(Dynamics(config.model), replace(forward.bounds, **bounds))
    view = View.of(radar, detections, stamp_ns)
    return update(before, view, steps, INTERVAL_S, track_numbers.first_detected(0))


def scan_at(seconds, measurement, amplitude=None, **more):
    """Return the scan of one radar so long after the start."""
    measurement = np.reshape(measurement, (-1, 2)).astype(float)
    return Scan(START_NS + round(seconds * 1e9), (Detections(measurement, amplitude, **more),))


def path(seconds, turn_rate=0.0):
    """Return where the target is at some times, shape (K, 5)."""
    heading = np.arctan2(MEAN[3], MEAN[1]) + turn_rate * np.asarray(seconds)
    speed = np.hypot(MEAN[1], MEAN[3])
    fine = np.linspace(0.0, max(seconds), 4000)
    course = np.arctan2(MEAN[3], MEAN[1]) + turn_rate * fine
    step = np.gradient(fine)
    east = np.interp(seconds, fine, np.cumsum(speed * np.cos(course) * step))
    north = np.interp(seconds, fine, np.cumsum(speed * np.sin(course) * step))
    return np.stack(
        [
            MEAN[0] + east,
            speed * np.cos(heading),
            MEAN[2] + north,
            speed * np.sin(heading),
            np.full(len(east), turn_rate),
        ],
        axis=1,
    )
