"""The forward PHD filter over the general mode: predict, update, resample.

All three are pure: intensity in, intensity out. The update keeps the split of the posterior into a
Poisson part and Bernoulli components (see `ParticlePHD`), which the smoother needs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from . import birth, detection_birth, motion, resampling
from .birth import BirthTerm
from .correction import Claims, Corrector, bernoulli, scale_rows
from .detection_birth import DetectionBirthModel, Newborn
from .modes import ModeSpace
from .radar import RadarModel
from .signature import AmplitudeModel
from .spawn import SpawnModel
from .types import Detections, FloatArray, IntArray, ParticlePHD, Scan, number, sum_by

# Origins are numbered scan by scan; the second half of a scan's numbers is for those that its
# detections found.
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
    corrector: Corrector = bernoulli
    state_size: int = motion.STATE_SIZE

    @property
    def labelled(self) -> bool:
        """Whether an origin is one target at the most, and so its name."""
        return self.corrector is bernoulli


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

    Returns
    -------
    ParticlePHD
        With all weight in the Poisson part.

    Notes
    -----
    Sec. IV-C, Step 1, with the survivor and birth steps that are missing there and the spawn
    weight in full.
    """
    origin = scan_index * ORIGINS_PER_SCAN
    parts = [
        _survivors(phd, model, dt, rng),
        _spawned(phd, model, dt, origin + len(model.births), rng),
    ]
    for index, term in enumerate(model.births):
        parts.append(_born(term, model, budget.per_birth_term, dt, origin + index, rng))
    return _concatenate(parts)


def _fresh(
    state: FloatArray,
    mode: IntArray,
    origin: IntArray,
    parent: IntArray,
    weight: FloatArray,
    memory: FloatArray,
) -> ParticlePHD:
    """Return single particles of no component yet."""
    return ParticlePHD(
        state=state,
        mode=mode,
        origin=origin,
        parent=parent,
        multiplicity=np.ones(len(weight), dtype=np.int64),
        poisson=weight,
        components=sparse.csr_array((len(weight), 0)),
        label=np.zeros(0, dtype=np.int64),
        memory=memory,
    )


def _concatenate(parts: list[ParticlePHD]) -> ParticlePHD:
    return _fresh(
        state=np.concatenate([part.state for part in parts]),
        mode=np.concatenate([part.mode for part in parts]),
        origin=np.concatenate([part.origin for part in parts]),
        parent=np.concatenate([part.parent for part in parts]),
        weight=np.concatenate([part.poisson for part in parts]),
        memory=np.concatenate([part.memory for part in parts]),
    )


def _draw_mode(transition: FloatArray, mode: IntArray, rng: np.random.Generator) -> IntArray:
    """Draw each row's next mode from its row of the [from, to] matrix."""
    cumulative = np.cumsum(transition, axis=1)
    cumulative[:, -1] = 1.0
    uniform = rng.random(len(mode))
    drawn = np.zeros(len(mode), dtype=np.int64)
    # Mode by mode: (N, O) temporaries would cost several times as much.
    for edge in cumulative.T[:-1]:
        drawn += uniform >= edge.take(mode)
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
    phd: ParticlePHD, model: TrackerModel, dt: float, origin: int, rng: np.random.Generator
) -> ParticlePHD:
    """Return the mass beside every target; where origins are targets, it founds new ones."""
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
    founder = phd.origin[parent]
    if model.labelled:
        founder = origin + number(founder)[1]
    return _fresh(state, mode, founder, parent, weight, memory)


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
    predicted = radar.measure(phd.state)
    in_range = predicted[:, 0] <= radar.max_range
    visible = np.flatnonzero(in_range)
    row, column, log_likelihood = radar.gated_pairs(predicted.take(visible, axis=0), detections)
    row = visible.take(row)
    log_likelihood += model.amplitudes.log_likelihood(
        phd, detections, (row, column), radar, model.modes
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
        mass=phd.weight.take(row) * np.exp(log_likelihood - scale.take(column)),
        other=other.sum(axis=0),
        detection_probability=np.where(
            in_range, model.amplitudes.detection_probability(phd, radar, model.modes), 0.0
        ),
    )
    corrected, claimed = model.corrector(phd, claims)
    if not model.detection_births.enabled:
        return corrected, None
    total = np.where(claims.other > 0.0, claims.other, 1.0)
    unknown = (1.0 - claimed) * other[1:] / total
    return corrected, detection_birth.newborn(radar, detections, unknown.T)


def update_scan(
    phd: ParticlePHD,
    scan: Scan,
    model: TrackerModel,
    dt: float,
    scan_index: int,
    rng: np.random.Generator,
) -> tuple[ParticlePHD, tuple[Newborn, ...]]:
    """Update with every radar that reported, in the configured order.

    A target that one radar found is there when the next one's detections are shared out, so that
    both have found one target and not two.
    """
    origin = scan_index * ORIGINS_PER_SCAN + ORIGINS_PER_SCAN // 2
    found = []
    for radar, detections in zip(model.radars, scan.detections, strict=True):
        if detections is not None:
            phd, one = update(phd, detections, radar, model, dt)
            if one is not None:
                phd = _joined(phd, one, model, origin, rng)
                origin += len(one)
                found.append(one)
    return phd, tuple(found)


def _joined(
    phd: ParticlePHD, found: Newborn, model: TrackerModel, origin: int, rng: np.random.Generator
) -> ParticlePHD:
    """Return the intensity with newborn targets, each a component of its own."""
    state, mode, weight, detection = detection_birth.sample(
        found, model.detection_births, model.modes, rng
    )
    count = len(weight)
    labels = origin + np.arange(len(found)) if model.labelled else np.full(len(found), -1)
    own = sparse.csr_array((weight, detection, np.arange(count + 1)), shape=(count, len(found)))
    return ParticlePHD(
        state=np.concatenate([phd.state, state]),
        mode=np.concatenate([phd.mode, mode]),
        origin=np.concatenate([phd.origin, origin + detection]),
        parent=np.concatenate([phd.parent, np.full(count, -1)]),
        multiplicity=np.concatenate([phd.multiplicity, np.ones(count, dtype=np.int64)]),
        poisson=np.concatenate([phd.poisson, np.zeros(count)]),
        components=sparse.block_diag([phd.components, own], format="csr"),
        label=np.concatenate([phd.label, labels]),
        memory=np.concatenate([phd.memory, model.amplitudes.born(mode, model.modes, rng)]),
    )


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
    origins, origin = number(phd.origin)
    key = modes.class_of[phd.mode] * len(origins) + origin
    # numpy sorts narrow integers by radix.
    narrow = key.astype(np.int16) if len(modes.classes) * len(origins) < 2**15 else key
    order = np.argsort(narrow, kind="stable")
    ranked = key[order]
    group = np.zeros(len(phd), dtype=np.int64)
    np.cumsum(ranked[1:] != ranked[:-1], out=group[1:])
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
        poisson=phd.poisson[row] * factor,
        components=scale_rows(phd.components[row], factor),
        label=phd.label,
        memory=phd.memory[row],
    )
