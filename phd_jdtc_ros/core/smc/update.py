# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The update: every radar's detections correct the intensity in turn.

Pure, as `prediction.predict` is: intensity in, intensity out. The posterior stays split into a
Poisson part and Bernoulli components (see `ParticleSet`), which the smoother needs.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from .. import origins
from ..models import detection_birth
from ..models.detection_birth import Newborn
from ..models.radar import RadarModel
from ..models.tracker_model import TrackerModel
from ..types import Detections, Scan
from .correction import Claims, Corrector
from .overload import thinned
from .particle_set import ParticleSet


def update(
    particles: ParticleSet,
    detections: Detections,
    radar: RadarModel,
    model: TrackerModel,
    corrector: Corrector,
    dt: float,
) -> tuple[ParticleSet, Newborn | None]:
    """Update the intensity with one radar's detections.

    Parameters
    ----------
    particles : ParticleSet
    detections : Detections
        M of them; zero is a valid report.
    radar : RadarModel
    model : TrackerModel
    corrector : Corrector
    dt : float
        True interval since the scan before, seconds.

    Returns
    -------
    particles : ParticleSet
        Corrected; see `correction`.
    found : Newborn or None
        What unknown targets explain of these detections, where births come from detections.

    Notes
    -----
    Sec. IV-C, Step 2. Radars are applied in turn (iterated corrector). What explains a detection
    is compared relative to the largest of its terms: above an amplitude of 38 the clutter density
    alone would underflow.
    """
    detections = model.amplitudes.used(detections)
    predicted = radar.measure(particles.state)
    in_range = predicted[:, 0] <= radar.max_range
    predicted[~in_range, 0] = np.inf  # near no detection
    detections, radar, share = thinned(predicted, detections, radar)
    row, column, log_likelihood = radar.gated_pairs(predicted, detections)
    log_likelihood += model.amplitudes.log_likelihood(
        particles.mode, particles.log_snr, detections, (row, column), radar, model.modes
    )
    log_other = radar.log_clutter_intensity(detections)[None]
    if model.detection_births.enabled:
        log_birth = model.detection_births.log_intensity(detections, radar, model.modes, dt)
        log_other = np.concatenate([log_other, log_birth])
    scale = log_other.max(axis=0)
    np.maximum.at(scale, column, log_likelihood)
    other = np.exp(log_other - scale)

    claims = Claims(
        row=row,
        column=column,
        mass=particles.weight.take(row) * np.exp(log_likelihood - scale.take(column)),
        other=other.sum(axis=0),
        detection_probability=np.where(
            in_range,
            share
            * model.amplitudes.detection_probability(
                particles.mode, particles.log_snr, radar, model.modes
            ),
            0.0,
        ),
    )
    corrected, claimed = corrector.correct(particles, claims)
    if not model.detection_births.enabled:
        return corrected, None
    total = np.where(claims.other > 0.0, claims.other, 1.0)
    unknown = (1.0 - claimed) * other[1:] / total
    return corrected, detection_birth.newborn(radar, detections, unknown.T)


def update_scan(
    particles: ParticleSet,
    scan: Scan,
    model: TrackerModel,
    corrector: Corrector,
    dt: float,
    scan_index: int,
    rng: np.random.Generator,
) -> tuple[ParticleSet, tuple[Newborn, ...]]:
    """Update with every radar that reported, in the configured order.

    A target that one radar found is there when the next one's detections are shared out, so that
    both have found one target and not two.
    """
    origin = origins.first_detected(scan_index)
    found = []
    for radar, detections in zip(model.radars, scan.detections, strict=True):
        if detections is not None:
            particles, one = update(particles, detections, radar, model, corrector, dt)
            if one is not None:
                one, count = detection_birth.affordable(one, model.detection_births)
                particles = _joined(particles, one, count, model, corrector, origin, rng)
                origin += len(one)
                found.append(one)
    return particles, tuple(found)


def _joined(
    particles: ParticleSet,
    found: Newborn,
    each: int,
    model: TrackerModel,
    corrector: Corrector,
    origin: int,
    rng: np.random.Generator,
) -> ParticleSet:
    """Return the intensity with newborn targets, components of `each` particles."""
    state, mode, weight, detection = detection_birth.sample(
        found, model.detection_births, model.modes, each, rng
    )
    count = len(weight)
    amplitude = None if found.amplitude is None else found.amplitude.take(detection)
    log_snr = model.amplitudes.born(mode, model.modes, rng, amplitude)
    labels = origin + np.arange(len(found)) if corrector.labelled else np.full(len(found), -1)
    own = sparse.csr_array((weight, detection, np.arange(count + 1)), shape=(count, len(found)))
    return ParticleSet(
        state=np.concatenate([particles.state, state]),
        mode=np.concatenate([particles.mode, mode]),
        origin=np.concatenate([particles.origin, origin + detection]),
        parent=np.concatenate([particles.parent, np.full(count, -1)]),
        multiplicity=np.concatenate([particles.multiplicity, np.ones(count, dtype=np.int64)]),
        poisson=np.concatenate([particles.poisson, np.zeros(count)]),
        components=sparse.block_diag([particles.components, own], format="csr"),
        label=np.concatenate([particles.label, labels]),
        log_snr=np.concatenate([particles.log_snr, log_snr]),
    )
