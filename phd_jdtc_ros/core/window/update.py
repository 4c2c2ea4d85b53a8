"""The update of hypotheses with the reports of a scan, each of which corrects them in turn."""

from __future__ import annotations

from typing import NamedTuple

from ..factors.factor import Look
from ..factors.state import Factors
from ..gaussian.reduction import Branched
from ..gaussian.update import GaussianSteps
from ..models.competing_sources import log_intensities
from ..models.detection_birth import EarlierLooks, Newborn
from ..models.tracker_model import TrackerModel
from ..sensors.view import View
from ..tracks import track_numbers
from ..types import Scan
from .self_reports import after_look


class Updated(NamedTuple):
    """Hypotheses and factors after one report or more."""

    rows: Branched
    factors: Factors
    newborns: tuple[Newborn, ...] = ()  # By report; empty if births at detections are disabled
    # Number of clusters of targets too large for exact association probabilities.
    approximate: int = 0


def update_scan(
    rows: Branched, scan: Scan, steps: GaussianSteps, dt: float, scan_index: int, factors: Factors
) -> Updated:
    """Update with the report of every sensor, in the configured order (iterated corrector).

    Targets born at the detections of one report join the rows before the next one, so that two
    sensors that detect a new target do not give birth to it twice. The rows are predicted, `dt` is
    the true interval since the previous scan in seconds, and births have labels by `scan_index`.
    """
    label, after = track_numbers.first_detected(scan_index), Updated(rows, factors)
    for report in steps.dynamics.model.reports(scan):
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
