"""The update (Sec. IV-C, Step 2): the detections of each radar correct the intensity in turn.

The functions are pure. The posterior stays split into a Poisson part and Bernoulli components (see
`ParticleSet`), because the smoother needs the split.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from ..arrays import FloatArray, IntArray, factorize, sum_by
from ..association.bernoulli import Claims, undetected
from ..attributes.memory import AttributeMemory, AttributesAt
from ..attributes.readings import Paired, plain
from ..models import detection_birth
from ..models.clutter_learning import ClutterMemory
from ..models.competing_sources import other_sources
from ..models.detection_birth import Newborn
from ..models.detection_limit import thinned
from ..models.tracker_model import TrackerModel
from ..sensors.polar_radar import RadarModel
from ..tracks import labels as origins
from ..types import Detections, Scan
from .correction import Corrector
from .particle_set import ParticleSet
from .strays import with_strays


def update(
    particles: ParticleSet,
    detections: Detections,
    radar: RadarModel,
    model: TrackerModel,
    corrector: Corrector,
    dt: float,
    rng: np.random.Generator,
    clutter: ClutterMemory | None = None,
    earlier: Sequence[Newborn] = (),
    attributes: AttributesAt | None = None,
) -> tuple[ParticleSet, Newborn | None]:
    """Update the intensity with one radar's detections.

    Parameters
    ----------
    particles : ParticleSet
    detections : Detections
        M of them; a report without detections is valid.
    radar : RadarModel
    model : TrackerModel
    corrector : Corrector
    dt : float
        True interval since the previous scan, seconds.
    rng : numpy.random.Generator
    clutter : ClutterMemory or None
        What is known of the radar's clutter, to learn from these detections; None to go by the
        radar model alone.
    earlier : sequence of Newborn
        Targets born at the detections of the scan's earlier radars.
    attributes : AttributesAt or None
        What is known of identities and heights, to use and to learn; None to leave them out.

    Returns
    -------
    particles : ParticleSet
        Corrected; see `correction`.
    newborn : Newborn or None
        Targets born at these detections; None if births at detections are disabled.

    Notes
    -----
    Sec. IV-C, Step 2. Radars are applied in turn (iterated corrector).
    """
    detections = model.amplitudes.used(detections)
    radar = radar if clutter is None else clutter.informed(radar)
    measured, predicted = _expected(particles, radar)
    targets = float(particles.weight.sum())
    detections, radar, share = thinned(predicted, targets, detections, radar)
    pairs = _paired(particles, predicted, detections, radar, attributes)
    if attributes is not None:
        origin, target = factorize(particles.origin)
        lost = attributes.lost(origin, target[pairs.row], pairs.column, detections)
        if lost is not None:
            particles = with_strays(particles, lost, detections, radar, model, rng)
            measured, predicted = _expected(particles, radar)
            target = factorize(particles.origin)[1]
            pairs = _paired(particles, predicted, detections, radar, attributes)
    row, column, log_likelihood = pairs[:3]
    detectable = radar.missable(measured, detections.coverage) * share
    detectable *= model.amplitudes.detection_probability(
        particles.mode, particles.log_snr, predicted[:, 0], radar, model.modes
    )
    log_likelihood += radar.log_range_rate(particles.state, detections, (row, column))
    log_likelihood += model.amplitudes.log_likelihood(
        particles.mode, particles.log_snr, detections, (row, column), radar, model.modes
    )
    evidence = None
    if attributes is not None:
        existence, missed = (
            sum_by(target, weight, len(origin))
            for weight in (particles.weight, particles.weight * (1.0 - detectable))
        )
        evidence = attributes.evidence(
            origin, target.take(row), column, detections, undetected(existence, missed)
        )
    if evidence is not None:
        log_likelihood += evidence.log_factor
    others = other_sources(
        *(detections, radar, model, dt, column, log_likelihood, earlier),
        *(() if evidence is None else (evidence.log_clutter, evidence.log_unknown)),
    )

    claims = Claims(
        row=row,
        column=column,
        mass=particles.weight.take(row) * np.exp(log_likelihood - others.log_scale.take(column)),
        other=others.total,
        detection_probability=detectable,
    )
    corrected, claimed, pair = corrector.correct(particles, claims)
    if attributes is not None and evidence is not None:
        existence = sum_by(target, corrected.weight, len(origin))
        attributes.learn(evidence, pair, existence)
    if clutter is not None and clutter.learns(radar):
        velocity = particles.state[:, list(radar.space.velocity)]
        slow = np.hypot(velocity[:, 0], velocity[:, 1]) < radar.clutter_map_speed
        still = model.detection_births.at_rest(claims.part(slow), radar.clutter_map_speed)
        clutter.learn(radar, detections, claimed, still)
    return corrected, others.newborn(claimed, radar, detections, model, share)


def _expected(particles: ParticleSet, radar: RadarModel) -> tuple[FloatArray, FloatArray]:
    """Return what a radar would measure of particles, and that with those out of range nowhere."""
    measured = radar.measure(particles.state)
    predicted = measured.copy()
    predicted[predicted[:, 0] > radar.max_range, 0] = np.inf  # outside every detection's gate
    return measured, predicted


def _paired(
    particles: ParticleSet,
    predicted: FloatArray,
    detections: Detections,
    radar: RadarModel,
    attributes: AttributesAt | None,
) -> Paired:
    """Return the pairs of particles and detections, with their log likelihoods."""

    def gate(seen: Detections) -> tuple[IntArray, IntArray, FloatArray]:
        rate = None if seen.time_s is None else radar.measurement_rate(particles.state)
        return radar.gated_pairs(predicted, seen, rate)

    if attributes is None:
        return plain(gate, detections)
    return attributes.paired(
        *(gate, *factorize(particles.origin), detections),
        *(radar.deviations(detections), radar.height_reading),
    )


def update_scan(
    particles: ParticleSet,
    scan: Scan,
    model: TrackerModel,
    corrector: Corrector,
    dt: float,
    scan_index: int,
    rng: np.random.Generator,
    clutter: ClutterMemory | None = None,
    attributes: AttributeMemory | None = None,
) -> tuple[ParticleSet, tuple[Newborn, ...]]:
    """Update with every radar that reported, in the configured order.

    Targets born at one radar's detections join the intensity before the next radar's update, so
    that two radars that detect a new target do not give birth to it twice.

    Returns
    -------
    particles : ParticleSet
    newborns : tuple of Newborn
        Targets born at detections, by radar.
    """
    origin = origins.first_detected(scan_index)
    known = None if attributes is None else attributes.at(scan.stamp_ns)
    newborns: list[Newborn] = []
    for radar, detections in model.reports(scan):
        particles, newborn = update(
            particles, detections, radar, model, corrector, dt, rng, clutter, newborns, known
        )
        if newborn is not None:
            newborn, count = detection_birth.affordable(newborn, model.detection_births)
            particles = _with_newborn(particles, newborn, count, model, corrector, origin, rng)
            if known is not None:
                known.born(origin, newborn.detections)
            origin += len(newborn)
            newborns.append(newborn)
    return particles, tuple(newborns)


def _with_newborn(
    particles: ParticleSet,
    newborn: Newborn,
    each: int,
    model: TrackerModel,
    corrector: Corrector,
    origin: int,
    rng: np.random.Generator,
) -> ParticleSet:
    """Return the intensity with newborn targets added, components of `each` particles."""
    state, mode, weight, detection = detection_birth.sample(
        newborn, model.detection_births, model.modes, each, rng
    )
    count, births = len(weight), len(newborn)
    amplitude = newborn.detections.amplitude
    amplitude = None if amplitude is None else amplitude.take(detection)
    log_snr = model.amplitudes.born(mode, model.modes, rng, amplitude)
    labels = origin + np.arange(births) if corrector.labelled else np.full(births, -1)
    added = sparse.csr_array((weight, detection, np.arange(count + 1)), shape=(count, births))
    return ParticleSet(
        state=np.concatenate([particles.state, state]),
        mode=np.concatenate([particles.mode, mode]),
        origin=np.concatenate([particles.origin, origin + detection]),
        parent=np.concatenate([particles.parent, np.full(count, -1)]),
        multiplicity=np.concatenate([particles.multiplicity, np.ones(count, dtype=np.int64)]),
        poisson=np.concatenate([particles.poisson, np.zeros(count)]),
        components=sparse.block_diag([particles.components, added], format="csr"),
        label=np.concatenate([particles.label, labels]),
        log_snr=np.concatenate([particles.log_snr, log_snr]),
    )
