"""Hands scans and their associations over to the layer of self-reports."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, frozen, sum_by
from ..gaussian.mixture import Mixture
from ..gaussian.update import Posterior, PriorMixture
from ..models.tracker_model import TrackerModel
from ..reports.tables import Layer, Look, Rows
from ..sensors.view import View
from ..targets.amplitude_density import of_classes
from ..tracks.reporting_rule import slowest_s

# Lower bound of the existence probabilities by which others are divided.
LEAST_EXISTENCE = 1e-12


def layer_of(model: TrackerModel) -> Layer | None:
    """Return the layer of a model's receivers before any report; None without receivers."""
    if not model.receivers:
        return None
    # This compiles its functions, which no other tracker needs.
    from ..reports.beside import SelfReporting

    look_s = slowest_s(model) if model.radars else 0.0
    sizes = len(model.modes.classes), len(model.radars)
    return SelfReporting.of(model.receivers, model.noise_density, look_s, *sizes)


def after_look(layer: Layer, view: View, prior: PriorMixture, posterior: Posterior) -> Layer:
    """Return the layer after the update with one report of a radar."""
    plots = view.sensor.in_plane(view.detections)
    claims, size, count = posterior.claims, len(view.detections), len(prior.label)
    target = prior.target.take(claims.row)
    # Several hypotheses of a target have the same detection.
    pair, index = np.unique(target * max(size, 1) + claims.column, return_inverse=True)
    existence = np.maximum(posterior.existence, LEAST_EXISTENCE)
    of_target = pair // max(size, 1)
    claimed = sum_by(index.ravel(), posterior.pair_probability, len(pair)) / existence[of_target]
    times = view.detections.time_s
    look = frozen(
        Look(
            view.stamp_ns,
            [each.name for each in prior.steps.model.radars].index(view.sensor.name),
            np.ascontiguousarray(plots.position[:, :2]),
            np.ascontiguousarray(plots.covariance[:, :2, :2]),
            # Of errors of each plot's own the axes are not those of the radar.
            (view.detections.noise_std is None) * np.ascontiguousarray(plots.root[:, :2, :2]),
            np.zeros(size) if times is None else times.copy(),
            of_target,
            pair % max(size, 1),
            claimed,
            np.maximum(1.0 - sum_by(of_target, claimed, count), 0.0),
        )
    )
    place = layer.places(view.stamp_ns)
    return layer.after(_rows(prior.mixture), look, _seen(view, place, prior.steps.model))


def after_scan(layer: Layer, stored: Mixture, living: Iterable[IntArray], stamp_ns: int) -> Layer:
    """Return the layer after a scan, given its hypotheses and the labels of all targets."""
    return layer.noted(_rows(stored), np.unique(np.concatenate([*living])), stamp_ns)


def _rows(mixture: Mixture) -> Rows:
    known = mixture.hypotheses
    return Rows(known.label, known.target, known.weight, known.mean, known.covariance)


def _seen(view: View, place: FloatArray, model: TrackerModel) -> BoolArray:
    """Return whether a radar should have seen targets at places, (S,)."""
    if not len(place):
        return np.zeros(0, dtype=np.bool_)
    sensor = view.sensor
    heights = np.zeros((len(place), len(sensor.space.place) - 2))
    measured = sensor.linearise(np.concatenate([place, heights], axis=1))[0]
    usual = sensor.visibility.detection_probability(measured)
    if usual is None:
        usual = np.full(len(place), float(of_classes(sensor.threshold, model.modes.classes).max()))
    detected = view.detection_probability_at(usual, measured)
    sector = view.detections.coverage
    inside = sensor.visibility.coverage_probability(measured, sector, sensor.noise_std)
    # From this probability on a target should have been seen within some looks.
    seen: BoolArray = detected * inside > 0.3
    return seen
