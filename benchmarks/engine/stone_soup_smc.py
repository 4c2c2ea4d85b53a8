"""Stone Soup's SMC-PHD filter on the reference scenario's scans, to measure its cost only.

It consists of Stone Soup's own predictor, updater and resampler, with the reference configuration's
particles per target, births and survival. It has no gate, so every particle is paired with every
detection. No targets are extracted.
"""

from __future__ import annotations

import math
import time
from datetime import timedelta

import numpy as np
from stonesoup.predictor.particle import SMCPHDPredictor
from stonesoup.resampler.particle import SystematicResampler
from stonesoup.sampler.particle import ParticleSampler
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.updater.particle import SMCPHDUpdater

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.study.runs import SimulatedRun
from studies.peers.conversion import STATE, clutter_density
from studies.peers.problem import Problem


def step_times_ms(run: SimulatedRun, config: TrackerConfig, targets: int) -> list[float]:
    """Return the CPU milliseconds of prediction and updates, per scan.

    The configuration has the budget, births, survival and radars. Resampling after every radar
    keeps the particle budget of this number of targets.
    """
    np.random.seed(0)  # noqa: NPY002 - Stone Soup's resampler draws from the global generator
    size = targets * config.budget.per_target
    problem = Problem.of(run, config.model)
    predictor = _predictor(problem, len(config.model.births) * config.budget.per_birth_term / size)
    scans = list(problem.scans())
    before = scans[0][0] - timedelta(seconds=config.model.modes.interval_s)
    state = predictor.birth_sampler.sample({"num_samples": size}, timestamp=before)
    state.log_weight = np.full(size, math.log(targets / size))
    times = []
    for stamp, looks in scans:
        begin = time.process_time()
        state = predictor.predict(state, timestamp=stamp)
        for radar, seen in looks:
            updater = SMCPHDUpdater(
                measurement_model=None,
                clutter_intensity=clutter_density(radar),
                resampler=SystematicResampler(),
                prob_detect=problem.detection_probability(radar),
                num_samples=size,
            )
            hypotheses = [SingleHypothesis(state, detection) for detection in [None, *seen]]
            state = updater.update(MultipleHypothesis(hypotheses))
        times.append(1e3 * (time.process_time() - begin))
    return times


def _predictor(problem: Problem, birth_probability: float) -> SMCPHDPredictor:
    births = problem.model.births
    mean, std = (np.stack([getattr(b, name)[STATE] for b in births]) for name in ("mean", "std"))
    rng = np.random.default_rng(0)

    def born(num_samples: int) -> FloatArray:
        term = rng.integers(0, len(births), num_samples)
        noise = rng.standard_normal((num_samples, len(STATE)))
        sample: FloatArray = (mean[term] + std[term] * noise).T
        return sample

    return SMCPHDPredictor(
        transition_model=problem.predictor.transition_model,
        # Stone Soup takes a rate per second.
        death_probability=-math.log(problem.survival_probability) / problem.model.modes.interval_s,
        birth_probability=birth_probability,
        birth_rate=float(sum(term.rate.sum() for term in births)),
        birth_sampler=ParticleSampler(born, {}, ndim_state=len(STATE)),
    )
