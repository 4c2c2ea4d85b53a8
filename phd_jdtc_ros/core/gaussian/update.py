"""The update: every detection in a hypothesis's gate makes a new hypothesis of the same target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import FloatArray, IntArray, sum_by
from ..association.bernoulli import Claims, bernoulli, undetected
from ..attributes.memory import AttributeMemory, AttributesAt, Evidence
from ..attributes.readings import Paired, plain
from ..models.clutter_learning import ClutterMemory
from ..models.competing_sources import OtherSources, other_sources
from ..models.detection_birth import Newborn
from ..models.detection_limit import thinned
from ..models.tracker_model import TrackerModel
from ..sensors.polar_radar import RadarModel
from ..tracks import labels
from ..types import Detections, Scan
from .dynamics import Dynamics
from .measurement.amplitude import detection_probability, log_amplitude, slow
from .measurement.gating import Expected, gated
from .measurement.iterated_update import Located, located, rough_rates
from .measurement.newborn import newborn_mixture
from .measurement.pairs import likely, summed, weighed
from .mixture import Mixture
from .reduction import Bounds, Branched, probable
from .strays import with_strays


def update(
    predicted: Branched,
    detections: Detections,
    radar: RadarModel,
    dynamics: Dynamics,
    bounds: Bounds,
    dt: float,
    clutter: ClutterMemory | None = None,
    earlier: Sequence[Newborn] = (),
    attributes: AttributesAt | None = None,
) -> tuple[Branched, Newborn | None, int]:
    """Update the hypotheses with one radar's detections.

    Parameters
    ----------
    predicted : Branched
    detections : Detections
        M of them; a report without detections is valid.
    radar : RadarModel
    dynamics : Dynamics
    bounds : Bounds
    dt : float
        True interval since the previous scan, seconds.
    clutter : ClutterMemory or None
        What is known of the radar's clutter, to learn from these detections; None to go by the
        radar model alone.
    earlier : sequence of Newborn
        Targets born at the detections of the scan's earlier radars.
    attributes : AttributesAt or None
        What is known of identities and heights, to use and to learn; None to leave them out.

    Returns
    -------
    branched : Branched
        Hypotheses once without a detection, and once with each in their gates; the most probable of
        each target.
    newborn : Newborn or None
        Targets born at these detections; None if births at detections are disabled.
    approximate : int
        Number of clusters of targets too large for exact association probabilities.

    Notes
    -----
    Let psi(z) be the weight of all Gaussians of a target times their likelihood of detection z,
    and p(z) and p(0) the marginal probabilities that the target has detection z or none. A
    hypothesis with z has its weight times its likelihood, times p(z) / psi(z).
    """
    model, mixture = dynamics.model, predicted.mixture
    detections = model.amplitudes.used(detections)
    radar = radar if clutter is None else clutter.informed(radar)
    expected = Expected.of(mixture, radar)
    flat = expected.measured.reshape(-1, 2)
    detections, radar, share = thinned(flat, float(mixture.mass.sum()), detections, radar)
    amplitudes = log_amplitude(detections, radar, dynamics).T
    pairs = _pairs(mixture, expected, detections, radar, attributes)
    if attributes is not None:
        lost = attributes.lost(mixture.label, mixture.target[pairs.row], pairs.column, detections)
        if lost is not None:
            predicted = with_strays(predicted, lost, model)
            mixture, expected = predicted.mixture, Expected.of(predicted.mixture, radar)
            pairs = _pairs(mixture, expected, detections, radar, attributes)
    row, column, rough, reading, readings = pairs
    detectable = share * detection_probability(expected, detections, radar, dynamics)
    missed = mixture.weight * (1.0 - detectable)
    rates = radar.rates_of(readings)
    if rates is not None:
        rough = rough + rough_rates(mixture, row, reading, rates, radar)
    evidence = None
    if attributes is not None:
        alive = sum_by(mixture.target, summed(missed), len(mixture.label))
        evidence = attributes.evidence(
            *(mixture.label, mixture.target[row], column, detections),
            undetected(mixture.existence, alive),
        )
    if evidence is not None:
        rough = rough + evidence.log_factor[:, None]
    log_mass = rough[..., None] + amplitudes[column][:, None, :]
    others = _others(log_mass, column, detections, radar, model, dt, earlier, evidence)
    weight = weighed(mixture, row, column, log_mass, others)
    counted = likely(mixture, row, column, weight, missed, others)
    row, column, reading = row[counted], column[counted], reading[counted]
    evidence = None if evidence is None else evidence.take(counted)

    found = located(mixture, row, reading, readings, radar, rates)
    log_mass = found.log_likelihood.reshape(-1, mixture.mean.shape[1], 1)
    log_mass = log_mass + amplitudes[column][:, None, :]
    if evidence is not None:
        log_mass = log_mass + evidence.log_factor[:, None, None]
    others = _others(log_mass, column, detections, radar, model, dt, earlier, evidence)
    weight = weighed(mixture, row, column, log_mass, others)
    prior = np.where(mixture.mass > 0.0, mixture.mass, 1.0)
    claims = Claims(
        row=row,
        column=column,
        mass=summed(weight),
        other=others.total,
        detection_probability=summed(mixture.weight * detectable) / prior,
    )
    shares = bernoulli(mixture.target, len(mixture.label), mixture.mass, claims)
    if clutter is not None and clutter.learns(radar):
        still = model.detection_births.at_rest(
            claims.part(slow(mixture, radar)), radar.clutter_map_speed
        )
        clutter.learn(radar, detections, shares.claimed, still)
    factor = shares.missed[mixture.target] * shares.prior / prior
    weight = np.concatenate([missed * factor[:, None, None], weight * shares.pair[:, None, None]])
    source = np.concatenate([np.arange(len(mixture)), row])
    if attributes is not None and evidence is not None:
        mass = summed(weight)
        existence = sum_by(mixture.target[source], mass, len(mixture.label))
        attributes.learn(evidence, mass[len(mixture) :], existence)
    branched = _branched(predicted, source, weight, found, bounds)
    newborn = others.newborn(shares.claimed, radar, detections, model, share)
    return branched, newborn, shares.approximate


def _pairs(
    mixture: Mixture,
    expected: Expected,
    detections: Detections,
    radar: RadarModel,
    attributes: AttributesAt | None,
) -> Paired:
    """Return the pairs of hypotheses and detections in their gates."""

    def gate(seen: Detections) -> tuple[IntArray, IntArray, FloatArray]:
        return gated(mixture, expected, seen, radar)

    if attributes is None:
        return plain(gate, detections)
    return attributes.paired(
        *(gate, mixture.label, mixture.target, detections),
        *(radar.deviations(detections), radar.height_reading),
    )


def _others(
    log_mass: FloatArray,
    column: IntArray,
    detections: Detections,
    radar: RadarModel,
    model: TrackerModel,
    dt: float,
    earlier: Sequence[Newborn],
    evidence: Evidence | None,
) -> OtherSources:
    """Return the other sources of the detections, given log p_D L_z of the pairs, (P, R, S)."""
    largest = log_mass.max(axis=(1, 2))
    told = () if evidence is None else (evidence.log_clutter, evidence.log_unknown)
    return other_sources(detections, radar, model, dt, column, largest, earlier, *told)


def _branched(
    predicted: Branched, source: IntArray, weight: FloatArray, found: Located, bounds: Bounds
) -> Branched:
    """Return those hypotheses that are kept: first without a detection, then the pairs.

    Only their Gaussians are updated.
    """
    mixture = predicted.mixture
    kept, factor = probable(mixture.target[source], summed(weight), bounds)
    source, weight = source[kept], weight[kept] * factor[:, None, None]
    pair = np.where(kept >= len(mixture), kept - len(mixture), -1)
    mean, covariance = found.updated(mixture, source, pair)
    return Branched(
        Mixture(mixture.origin[source], weight, mean, covariance), predicted.parent[source]
    )


def update_scan(
    predicted: Mixture,
    survivors: int,
    scan: Scan,
    dynamics: Dynamics,
    bounds: Bounds,
    dt: float,
    scan_index: int,
    clutter: ClutterMemory | None = None,
    attributes: AttributeMemory | None = None,
) -> tuple[Branched, int]:
    """Update with every radar that reported, in the configured order.

    Targets born at one radar's detections join the mixture before the next radar's update, so that
    two radars that detect a new target do not give birth to it twice.

    Parameters
    ----------
    predicted : Mixture
    survivors : int
        Number of its first rows that come from earlier scans.
    scan : Scan
    dynamics : Dynamics
    bounds : Bounds
    dt : float
        True interval since the previous scan, seconds.
    scan_index : int
        Determines the origins of births.
    clutter : ClutterMemory or None
        See `update`.
    attributes : AttributeMemory or None
        What is known of identities and heights.

    Returns
    -------
    branched : Branched
    approximate : int
        Number of clusters of targets too large for exact association probabilities.
    """
    origin, approximate = labels.first_detected(scan_index), 0
    row = np.arange(len(predicted))
    branched = Branched(predicted, np.where(row < survivors, row, -1))
    newborns: list[Newborn] = []
    known = None if attributes is None else attributes.at(scan.stamp_ns)
    for radar, detections in dynamics.model.reports(scan):
        branched, newborn, clusters = update(
            branched, detections, radar, dynamics, bounds, dt, clutter, newborns, known
        )
        approximate += clusters
        if newborn is not None:
            newborns.append(newborn)
        if newborn is not None and len(newborn):
            branched = _joined(branched, newborn_mixture(newborn, dynamics, origin))
            if known is not None:
                known.born(origin, newborn.detections)
            origin += len(newborn)
    return branched, approximate


def _joined(branched: Branched, added: Mixture) -> Branched:
    """Return the hypotheses with those of newborn targets."""
    return Branched(
        Mixture.joined([branched.mixture, added]),
        np.concatenate([branched.parent, np.full(len(added), -1)]),
    )
