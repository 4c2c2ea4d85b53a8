"""The update of hypotheses with the reports of a scan, each of which corrects them in turn.

And the layer of self-reports, to which scans and their associations are handed over.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray, frozen, sum_by
from ..factors.factor import LEAST_EXISTENCE, Look
from ..factors.state import Factors
from ..gaussian.mixture import Mixture
from ..gaussian.reduction import Branched
from ..gaussian.update import GaussianSteps, Posterior, PriorMixture
from ..models.competing_sources import log_intensities
from ..models.detection_birth import EarlierLooks, Newborn
from ..models.tracker_model import TrackerModel
from ..reports import tables
from ..sensors.view import View
from ..targets.amplitude_density import of_classes
from ..tracks import track_numbers
from ..tracks.reporting_rule import slowest_s


class Updated(NamedTuple):
    """Hypotheses and factors after one report or more."""

    rows: Branched
    factors: Factors
    newborns: tuple[Newborn, ...] = ()  # By report; empty if births at detections are disabled
    # Number of clusters of targets too large for exact association probabilities.
    approximate: int = 0


def update_scan(
    rows: Branched,
    reports: Iterable[View],
    steps: GaussianSteps,
    dt: float,
    scan_index: int,
    factors: Factors,
) -> Updated:
    """Update with the report of every sensor, in the configured order (iterated corrector).

    Targets born at the detections of one report join the rows before the next one, so that two
    sensors that detect a new target do not give birth to it twice. The rows are predicted, `dt` is
    the true interval since the previous scan in seconds, and births have labels by `scan_index`.
    """
    label, after = track_numbers.first_detected(scan_index), Updated(rows, factors)
    for report in reports:
        after = update(after, report, steps, dt, label)
        label += sum(map(len, after.newborns[-1:]))
    return after


def update(before: Updated, report: View, steps: GaussianSteps, dt: float, label: int) -> Updated:
    """Update with one report.

    `before` has the targets born at the detections of the scan's earlier reports too. `dt` is the
    true interval since the previous scan in seconds, and `label` the first of targets born here.
    """
    model, factors = steps.dynamics.model, before.factors
    expected = factors.expect(report)
    prior = steps.prior(before.rows, expected)
    view = factors.given(expected, prior)
    if not view.complete:
        prior = steps.prior(before.rows, view)
    prior, pairs = factors.gate(prior, view)
    evidence = factors.evidence(prior, pairs, view)
    unknown_s, looks = _unseen_since(view, model, dt, factors)
    log_other = log_intensities(view, model, unknown_s, before.newborns, evidence, looks)
    posterior = prior.posterior(pairs, evidence, log_other)
    # Without the clutter of a burst, in which new targets can wait.
    newborns = posterior.newborns(view, model, model.least_newborn_mass(expected))
    rows, born, born_at = steps.with_newborns(posterior.rows, newborns, label)
    learned = factors.after(Look(view, expected, prior, posterior, born, born_at))
    if learned.reports is not None:
        learned = learned.changed(reports=after_look(learned.reports, view, prior, posterior))
    return Updated(
        rows, learned, before.newborns + newborns, before.approximate + posterior.approximate
    )


def _unseen_since(
    view: View, model: TrackerModel, dt: float, factors: Factors
) -> tuple[float, EarlierLooks | None]:
    """Return the seconds in which undetected targets may have appeared, and the looks since then.

    The looks are those since the previous report of the view's sensor; None if that is unknown, and
    for a sector, whose births are those of a revolution.
    """
    looks, names = factors.looks, list(factors.by_sensor)
    if looks is None:
        return dt, None
    own = names.index(view.sensor.name)
    previous = None if view.detections.coverage else looks.since_last(view, own)
    if previous is not None:
        last, later = previous
        others = [factors.expect(looks.view(row, model.radars[looks.sensor[row]])) for row in later]
        return dt, EarlierLooks(int(looks.stamp_ns[last]), others)
    # The interval since the previous scan says nothing about that of a sensor which has not looked.
    is_own = looks.sensor == own
    others_looked = len(is_own) > 0 and not is_own.any()
    return max(dt, model.modes.interval_s) if others_looked else dt, None


def layer_of(model: TrackerModel) -> tables.Layer | None:
    """Return the layer of a model's receivers before any report; None without receivers."""
    if not model.receivers:
        return None
    # This compiles its functions, which no other tracker needs.
    from ..reports.beside import SelfReporting

    look_s = slowest_s(model) if model.radars else 0.0
    sizes = len(model.modes.classes), len(model.radars)
    return SelfReporting.of(model.receivers, model.noise_density, look_s, *sizes)


def after_look(
    layer: tables.Layer, view: View, prior: PriorMixture, posterior: Posterior
) -> tables.Layer:
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
        tables.Look(
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


def after_scan(
    layer: tables.Layer, stored: Mixture, living: Iterable[IntArray], stamp_ns: int
) -> tables.Layer:
    """Return the layer after a scan, given its hypotheses and the labels of all targets."""
    return layer.noted(_rows(stored), np.unique(np.concatenate([*living])), stamp_ns)


def _rows(mixture: Mixture) -> tables.Rows:
    known = mixture.hypotheses
    return tables.Rows(known.label, known.target, known.weight, known.mean, known.covariance)


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
