"""The Gaussian-mixture PHD filter."""

from __future__ import annotations

import math

from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.study.tracker import SimulatedRun, Tracks

from .conversion import clutter_density, point_set
from .problem import Problem
from .settings import GM_PHD, PhdSettings
from .soup import Part, Soup


def gm_phd(run: SimulatedRun, model: TrackerModel, settings: PhdSettings = GM_PHD) -> Tracks:
    """Return the estimates of Stone Soup's Gaussian-mixture PHD filter, at lag 0.

    They are the components with a weight above ``settings.extract``, all of class 0; for the model
    see `Problem.of`. Stone Soup's updater applies survival once per radar; here only the first
    radar of a scan applies it. It also drops components tagged as births if the first radar misses
    them. Births here have no such tag, and their weight is divided by the survival probability in
    advance.
    """
    problem = Problem.of(run, model)
    soup = problem.soup
    hypothesiser = soup.GaussianMixtureHypothesiser(
        problem.hypothesiser(settings.gate), order_by_detection=True
    )
    reducer = soup.GaussianMixtureReducer(
        prune_threshold=settings.prune,
        merge_threshold=settings.merge,
        max_number_components=settings.most,
    )
    mixture: list[Part] = []
    reports = []
    for stamp, looks in problem.scans():
        mixture = mixture + problem.births(stamp)
        survival = problem.survival_probability
        for radar, detections in looks:
            updater = soup.PHDUpdater(
                updater=problem.updater,
                clutter_spatial_density=clutter_density(radar),
                prob_detection=problem.detection_probability(radar),
                prob_survival=survival,
            )
            hypotheses = hypothesiser.hypothesise(mixture, detections, stamp)
            for hypothesis in (h for multiple in hypotheses[:-1] for h in multiple):
                hypothesis.measurement = nearest_turn(soup, hypothesis)
            # The reducer sorts by its random tags.
            reduced = reducer.reduce(list(updater.update(hypotheses).components))
            mixture = sorted(reduced, key=lambda c: (c.weight, *c.state_vector.flat))
            survival = 1.0
        reports.append(point_set(c for c in mixture if c.weight > settings.extract))
    return {0: reports}


def nearest_turn(soup: Soup, hypothesis: Part) -> Part:
    """Return a hypothesis' detection, with its bearing shifted to within pi of the predicted one.

    The bearing returned is a plain number. The predicted one is in [-pi, pi), but the bearing
    returned may be outside.
    """
    seen = hypothesis.measurement
    predicted = float(hypothesis.measurement_prediction.state_vector[0, 0])
    off = math.remainder(float(seen.state_vector[0, 0]) - predicted, 2.0 * math.pi)
    return soup.Detection(
        soup.StateVector([predicted + off, seen.state_vector[1, 0]]),
        timestamp=seen.timestamp,
        measurement_model=seen.measurement_model,
    )
