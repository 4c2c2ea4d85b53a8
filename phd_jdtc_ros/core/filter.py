"""The forward PHD filter over the general mode: predict, update, resample.

All three are pure: intensity in, intensity out. The update keeps the split of the posterior into
its Poisson part and one component a detection (see `ParticlePHD`), which the smoother needs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from . import birth, detection_birth, motion, resampling
from .birth import BirthTerm
from .detection_birth import DetectionBirthModel, Newborn
from .modes import ModeSpace
from .radar import RadarModel
from .signature import AmplitudeModel
from .spawn import SpawnModel
from .types import Detections, FloatArray, IntArray, ParticlePHD, Scan, sum_by

# Origins are numbered scan by scan; no scan founds more than this.
ORIGINS_PER_SCAN = 1 << 24


@dataclass(frozen=True)
class TrackerModel:
    """Everything the recursion assumes about targets and radars.

    Rates and probabilities hold for the mode space's nominal interval and follow the true one.
    """

    modes: ModeSpace
    births: tuple[BirthTerm, ...]
    detection_births: DetectionBirthModel
    spawn: SpawnModel
    amplitudes: AmplitudeModel
    radars: tuple[RadarModel, ...]
    state_size: int = motion.STATE_SIZE


@dataclass(frozen=True)
class ParticleBudget:
    """How many particles stand for what.

    Parameters
    ----------
    per_target : int
        Copies a unit of mass is resampled to.
    least : int
        Copies that a (class, origin) group gets at the least.
    per_birth_term : int
        A power of two.
    """

    per_target: int
    least: int
    per_birth_term: int


def predict(
    phd: ParticlePHD,
    model: TrackerModel,
    budget: ParticleBudget,
    dt: float,
    scan_index: int,
    rng: np.random.Generator,
    found: tuple[Newborn, ...] = (),
) -> ParticlePHD:
    """Move the intensity over `dt` seconds: survivors, spawned targets, births.

    Parameters
    ----------
    phd : ParticlePHD
        The stored set; each row is moved `multiplicity` times with noise of its own.
    model : TrackerModel
    budget : ParticleBudget
    dt : float
        True interval since the scan before, seconds.
    scan_index : int
        Names the births' origins.
    rng : numpy.random.Generator
    found : tuple of Newborn
        What the detections of the scan before leave to this one.

    Returns
    -------
    ParticlePHD
        With all weight unexplained.

    Notes
    -----
    Sec. IV-C, Step 1, with the survivor and birth steps that are missing there and the spawn
    weight in full.
    """
    parts = [_survivors(phd, model, dt, rng), _spawned(phd, model, dt, rng)]
    origin = scan_index * ORIGINS_PER_SCAN
    for term in model.births:
        parts.append(_born(term, model, budget.per_birth_term, dt, origin, rng))
        origin += 1
    for one in found:
        parts.append(_newborn(one, model, dt, origin, rng))
        origin += len(one)
    return _concatenate(parts)


def _fresh(
    state: FloatArray,
    mode: IntArray,
    origin: IntArray,
    parent: IntArray,
    weight: FloatArray,
    memory: FloatArray,
) -> ParticlePHD:
    """Return single particles that no detection explains yet."""
    return ParticlePHD(
        state=state,
        mode=mode,
        origin=origin,
        parent=parent,
        multiplicity=np.ones(len(weight), dtype=np.int64),
        unexplained=weight,
        explained=sparse.csr_array((len(weight), 0)),
        memory=memory,
    )


def _concatenate(parts: list[ParticlePHD]) -> ParticlePHD:
    return _fresh(
        state=np.concatenate([part.state for part in parts]),
        mode=np.concatenate([part.mode for part in parts]),
        origin=np.concatenate([part.origin for part in parts]),
        parent=np.concatenate([part.parent for part in parts]),
        weight=np.concatenate([part.unexplained for part in parts]),
        memory=np.concatenate([part.memory for part in parts]),
    )


def _draw_mode(transition: FloatArray, mode: IntArray, rng: np.random.Generator) -> IntArray:
    """Draw each row's next mode from its row of the [from, to] matrix."""
    cumulative = np.cumsum(transition, axis=1)
    cumulative[:, -1] = 1.0
    drawn: IntArray = (rng.random(len(mode))[:, None] >= cumulative[mode]).sum(axis=1)
    return drawn


def _survivors(
    phd: ParticlePHD, model: TrackerModel, dt: float, rng: np.random.Generator
) -> ParticlePHD:
    modes = model.modes
    copy = np.repeat(np.arange(len(phd)), phd.multiplicity)
    source_mode = phd.mode[copy]
    weight = (phd.weight / np.maximum(phd.multiplicity, 1))[copy] * modes.survival(dt)[source_mode]
    mode = _draw_mode(modes.transition(dt), source_mode, rng)
    state = np.empty((len(copy), phd.state.shape[1]))
    for index, motion_model in enumerate(modes.motions):
        chosen = np.flatnonzero(mode == index)
        state[chosen] = motion.sample(motion_model, phd.state[copy[chosen]], dt, rng)
    memory = model.amplitudes.moved(phd.memory[copy], mode, modes, rng)
    return _fresh(state, mode, phd.origin[copy], copy, weight, memory)


def _spawned(
    phd: ParticlePHD, model: TrackerModel, dt: float, rng: np.random.Generator
) -> ParticlePHD:
    spawn = model.spawn
    mass = float(phd.weight.sum())
    count = int(np.ceil(spawn.particles_per_target * mass)) if spawn.rate > 0.0 else 0
    group = np.zeros(len(phd), dtype=np.int64)
    copies = resampling.systematic(phd.weight, group, np.array([count]), rng)
    parent = np.repeat(np.arange(len(phd)), copies)
    mode = _draw_mode(spawn.transition, phd.mode[parent], rng)
    state = np.empty((len(parent), phd.state.shape[1]))
    for index, motion_model in enumerate(model.modes.motions):
        chosen = np.flatnonzero(mode == index)
        centre = motion_model.mean(phd.state[parent[chosen]], dt)
        support = list(motion_model.support)
        noise = rng.standard_normal((len(chosen), len(support))) * spawn.std[support]
        centre[:, support] += noise
        state[chosen] = centre
    rate = spawn.rate * dt / model.modes.interval_s
    weight = np.full(len(parent), rate * mass / max(count, 1))
    memory = model.amplitudes.born(mode, model.modes, rng)
    return _fresh(state, mode, phd.origin[parent], parent, weight, memory)


def _born(
    term: BirthTerm,
    model: TrackerModel,
    count: int,
    dt: float,
    origin: int,
    rng: np.random.Generator,
) -> ParticlePHD:
    state, mode = birth.sample(term, model.modes, count, rng)
    expected = float(term.rate.sum()) * dt / model.modes.interval_s
    return _fresh(
        state,
        mode,
        np.full(count, origin),
        np.full(count, -1),
        np.full(count, expected / count),
        model.amplitudes.born(mode, model.modes, rng),
    )


def _newborn(
    found: Newborn, model: TrackerModel, dt: float, origin: int, rng: np.random.Generator
) -> ParticlePHD:
    state, mode, weight, detection = detection_birth.sample(
        found, model.detection_births, model.modes, dt, rng
    )
    memory = model.amplitudes.born(mode, model.modes, rng)
    return _fresh(state, mode, origin + detection, np.full(len(mode), -1), weight, memory)


def update(
    phd: ParticlePHD, detections: Detections, radar: RadarModel, model: TrackerModel, dt: float
) -> tuple[ParticlePHD, Newborn | None]:
    """Update the intensity with one radar's detections.

    Parameters
    ----------
    phd : ParticlePHD
    detections : Detections
        M of them; zero is a valid report.
    radar : RadarModel
    model : TrackerModel
    dt : float
        True interval since the scan before, seconds.

    Returns
    -------
    phd : ParticlePHD
        Earlier components multiplied by 1 - p_D, M components of this radar's added.
    found : Newborn or None
        What these detections leave to the next scan, where births come from detections.

    Notes
    -----
    Sec. IV-C, Step 2. Radars are applied in turn (iterated corrector). Each detection's quotient
    is formed relative to the largest of its terms: above an amplitude of 38 the clutter density
    alone would underflow.
    """
    detections = model.amplitudes.used(detections)
    size = len(detections)
    predicted = radar.measure(phd.state)
    in_range = predicted[:, 0] <= radar.max_range
    visible = np.flatnonzero(in_range)
    row, column, log_likelihood = radar.gated_pairs(predicted[visible], detections)
    row = visible[row]
    log_likelihood = log_likelihood + model.amplitudes.log_likelihood(
        phd, detections, (row, column), radar, model.modes
    )
    log_other = radar.log_clutter_intensity(detections)[None]
    if model.detection_births.enabled:
        log_birth = model.detection_births.log_intensity(detections, radar, model.modes, dt)
        log_other = np.concatenate([log_other, log_birth])
    scale = log_other.max(axis=0)
    np.maximum.at(scale, column, log_likelihood)

    weighted = phd.weight[row] * np.exp(log_likelihood - scale[column])
    other = np.exp(log_other - scale)
    normaliser = other.sum(axis=0) + sum_by(column, weighted, size)
    normaliser = np.where(normaliser > 0.0, normaliser, 1.0)
    part = sparse.csr_array((weighted / normaliser[column], (row, column)), shape=(len(phd), size))
    p_d = model.amplitudes.detection_probability(phd, radar, model.modes)
    missed = 1.0 - np.where(in_range, p_d, 0.0)
    updated = replace(
        phd,
        unexplained=phd.unexplained * missed,
        explained=sparse.hstack([scale_rows(phd.explained, missed), part], format="csr"),
    )
    if not model.detection_births.enabled:
        return updated, None
    return updated, detection_birth.newborn(radar, detections, (other[1:] / normaliser).T)


def update_scan(
    phd: ParticlePHD, scan: Scan, model: TrackerModel, dt: float
) -> tuple[ParticlePHD, tuple[Newborn, ...]]:
    """Update with every radar that reported, in the configured order."""
    found = []
    for radar, detections in zip(model.radars, scan.detections, strict=True):
        if detections is not None:
            phd, one = update(phd, detections, radar, model, dt)
            found.append(one)
    return phd, tuple(one for one in found if one is not None)


def scale_rows(matrix: sparse.csr_array, factor: FloatArray) -> sparse.csr_array:
    """Return a CSR array with each row multiplied by its factor; the pattern is shared."""
    data = matrix.data * np.repeat(factor, np.diff(matrix.indptr))
    return sparse.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


def resample(
    phd: ParticlePHD, modes: ModeSpace, budget: ParticleBudget, rng: np.random.Generator
) -> ParticlePHD:
    """Resample within each (class, origin) to unique rows with a multiplicity.

    Parameters
    ----------
    phd : ParticlePHD
        Updated.
    modes : ModeSpace
    budget : ParticleBudget
    rng : numpy.random.Generator

    Returns
    -------
    ParticlePHD
        Sorted by (class, origin); every component of a row is scaled by its new over its old
        weight.

    Notes
    -----
    Sec. IV-C, Step 3. Deviation: within class and origin, not class alone.
    """
    key = np.stack([modes.class_of[phd.mode], phd.origin], axis=1)
    order = np.lexsort((key[:, 1], key[:, 0]))
    changed = np.any(np.diff(key[order], axis=0) != 0, axis=1)
    group = np.concatenate([[0], np.cumsum(changed)]).astype(np.int64)[: len(phd)]
    weight = phd.weight[order]
    mass = sum_by(group, weight, int(group[-1]) + 1 if len(group) else 0)
    count, copy_weight = resampling.allocate(mass, budget.per_target, budget.least, rng)
    copies = resampling.systematic(weight, group, count, rng)
    kept = np.flatnonzero(copies)
    row = order[kept]
    factor = copies[kept] * copy_weight[group[kept]] / weight[kept]
    return ParticlePHD(
        state=phd.state[row],
        mode=phd.mode[row],
        origin=phd.origin[row],
        parent=phd.parent[row],
        multiplicity=copies[kept],
        unexplained=phd.unexplained[row] * factor,
        explained=scale_rows(phd.explained[row], factor),
        memory=phd.memory[row],
    )
