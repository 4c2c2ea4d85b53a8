"""Stone Soup's SMC-PHD filter on the reference scenario's scans, to measure its cost only.

It consists of Stone Soup's own predictor, updater and resampler, with the reference configuration's
particles per target, births and survival. It has no gate, so every particle is paired with every
detection. No targets are extracted.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta

import numpy as np
from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
)
from stonesoup.predictor.particle import SMCPHDPredictor
from stonesoup.resampler.particle import SystematicResampler
from stonesoup.sampler.particle import ParticleSampler
from stonesoup.types.angle import Bearing
from stonesoup.types.array import StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.updater.particle import SMCPHDUpdater

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.state_space import VX, VY, X, Y
from phd_jdtc_ros.core.types import Scan

STATE = [X, VX, Y, VY]
EPOCH = datetime(2000, 1, 1)


def step_times_ms(scans: Sequence[Scan], config: TrackerConfig, targets: int) -> list[float]:
    """Return the CPU milliseconds of prediction and updates, per scan.

    Parameters
    ----------
    config : TrackerConfig
        For the budget, births, survival and radars.
    targets : int
        Number of targets whose particle budget is kept by resampling after every radar.
    """
    np.random.seed(0)  # noqa: NPY002 - Stone Soup's resampler draws from the global generator
    size = targets * config.budget.per_target
    predictor = _predictor(config, size)
    updaters = [_updater(radar, config, size) for radar in config.model.radars]
    stamps = [EPOCH + timedelta(microseconds=scan.stamp_ns / 1000) for scan in scans]
    before = stamps[0] - timedelta(seconds=config.model.modes.interval_s)
    state = predictor.birth_sampler.sample({"num_samples": size}, timestamp=before)
    state.log_weight = np.full(size, math.log(targets / size))
    times = []
    for stamp, scan in zip(stamps, scans, strict=True):
        begin = time.process_time()
        state = predictor.predict(state, timestamp=stamp)
        for updater, report in zip(updaters, scan.detections, strict=True):
            measurement = np.zeros((0, 2)) if report is None else report.measurement
            seen = _detections(measurement, stamp, updater.measurement_model)
            hypotheses = [SingleHypothesis(state, detection) for detection in [None, *seen]]
            state = updater.update(MultipleHypothesis(hypotheses))
        times.append(1e3 * (time.process_time() - begin))
    return times


def _predictor(config: TrackerConfig, size: int) -> SMCPHDPredictor:
    model = config.model
    axis = ConstantVelocity(model.modes.motions[0].noise_density)
    survival = np.mean([c.survival_probability for c in model.modes.classes])
    births = len(model.births) * config.budget.per_birth_term
    rng = np.random.default_rng(0)

    def born(num_samples: int) -> FloatArray:
        term = rng.integers(0, len(model.births), num_samples)
        mean, std = (
            np.stack([getattr(b, n)[STATE] for b in model.births]) for n in ("mean", "std")
        )
        sample: FloatArray = mean[term] + std[term] * rng.standard_normal((num_samples, len(STATE)))
        return sample.T

    return SMCPHDPredictor(
        transition_model=CombinedLinearGaussianTransitionModel([axis, axis]),
        # Stone Soup takes a rate per second.
        death_probability=-math.log(survival) / model.modes.interval_s,
        birth_probability=births / size,
        birth_rate=float(sum(term.rate.sum() for term in model.births)),
        birth_sampler=ParticleSampler(born, {}, ndim_state=len(STATE)),
    )


def _updater(radar: RadarModel, config: TrackerConfig, size: int) -> SMCPHDUpdater:
    sensor = CartesianToBearingRange(
        ndim_state=len(STATE),
        mapping=[0, 2],
        noise_covar=np.diag([radar.azimuth_std**2, radar.range_std**2]),
        translation_offset=StateVector(radar.position),
        rotation_offset=StateVector([0.0, 0.0, radar.yaw]),
    )
    classes = config.model.modes.classes
    return SMCPHDUpdater(
        measurement_model=sensor,
        clutter_intensity=radar.clutter_rate / (2.0 * math.pi * radar.clutter_max_range),
        resampler=SystematicResampler(),
        prob_detect=float(radar.class_detection_probability(classes).mean()),
        num_samples=size,
    )


def _detections(
    measurement: FloatArray, stamp: datetime, sensor: CartesianToBearingRange
) -> Iterator[Detection]:
    for radius, azimuth in measurement:
        yield Detection(
            StateVector([Bearing(azimuth), radius]), timestamp=stamp, measurement_model=sensor
        )
