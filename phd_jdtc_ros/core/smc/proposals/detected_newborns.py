"""Redraws the velocities of targets born at a detection when the next detections arrive.

A newborn target's velocity has only its prior. Where the prior is broad, hardly any particle comes
near the next detection. The velocities are therefore drawn by importance sampling, partly from the
prior and partly near the velocities that lead to one of the next detections. Importance weights
keep the newborn's density unchanged.

Where a radar measures range rates, a newborn target's velocity is known better and is not redrawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...arrays import FloatArray
from ...models.detection_birth import DetectionBirthModel
from ...models.tracker_model import TrackerModel
from ...tracks.labels import born_at_detection
from ...window.entries import UnsweptRows
from ..kernel.backward_kernel import UnsweptParticles
from ..particle_set import scale_rows
from .detections_in_plane import InPlane

# Velocities are redrawn if they spread the target's position over more than this many standard
# deviations of a detection.
BROAD = 2.0
# Gate, in standard deviations of the prior velocity, on a newborn target's next detection.
REACH_SIGMA = 3.0
# Share of the particles whose velocities come from the prior.
PRIOR_SHARE = 0.25
# Factor on a detection's standard deviation in the spread of the velocities drawn towards it.
INFLATION = 1.5


def redraw_velocities(
    swept: Sequence[UnsweptParticles],
    stamp_ns: int,
    detections: InPlane,
    model: TrackerModel,
    rng: np.random.Generator,
) -> list[UnsweptParticles]:
    """Return the rows that a scan sweeps, with the velocities of newborn targets redrawn.

    `stamp_ns` and `detections` are those of the scan.
    """
    measured = any(radar.range_rate is not None for radar in model.radars)
    if measured or not model.detection_births.enabled:
        return list(swept)
    return [
        _redraw_velocities(rows, (stamp_ns - rows.entry.stamp_ns) * 1e-9, detections, model, rng)
        for rows in swept
    ]


def _redraw_velocities(
    rows: UnsweptParticles,
    dt: float,
    detections: InPlane,
    model: TrackerModel,
    rng: np.random.Generator,
) -> UnsweptParticles:
    stored, births = rows.entry.stored, model.detection_births
    largest_std = np.sqrt(np.linalg.eigvalsh(detections.covariance)[:, -1])
    precise = births.velocity_std * dt > BROAD * largest_std
    detections = detections.take(np.flatnonzero(precise))
    newborn = (stored.parent < 0) & born_at_detection(stored.row_label)
    if rows.rows is not None:
        is_unswept = np.zeros(len(stored), dtype=bool)
        is_unswept[rows.rows] = True
        newborn &= is_unswept
    newborn_rows = np.flatnonzero(newborn)
    if not len(newborn_rows) or not len(detections.position):
        return rows
    position_axes = list(model.modes.space.position)
    velocity_axes = list(model.modes.space.velocity)
    state, factor = stored.state.copy(), np.ones(len(stored))
    spread = [INFLATION * np.linalg.cholesky(matrix) / dt for matrix in detections.covariance]
    reach = REACH_SIGMA * births.velocity_std * dt
    for label in np.unique(stored.row_label[newborn_rows]):
        row = newborn_rows[stored.row_label[newborn_rows] == label]
        centre = state[row][:, position_axes].mean(axis=0)
        in_reach = np.flatnonzero(np.hypot(*(detections.position - centre).T) <= reach)
        if len(in_reach):
            leads = (detections.position[in_reach][:, None] - state[row][:, position_axes]) / dt
            velocity, ratio = _draw(leads, [spread[index] for index in in_reach], births, rng)
            state[np.ix_(row, velocity_axes)] = velocity
            weight = stored.weight[row]
            factor[row] = ratio * weight.sum() / (ratio * weight).sum()
    redrawn = replace(
        stored,
        state=state,
        poisson=stored.poisson * factor,
        components=scale_rows(stored.components, factor),
    )
    return UnsweptRows(replace(rows.entry, stored=redrawn), rows.rows)


def _draw(
    leads: FloatArray,
    spreads: Sequence[FloatArray],
    births: DetectionBirthModel,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Draw velocities from a mixture; return also the ratio of prior to mixture density.

    `leads` has the velocities that lead each particle to each detection, (J, n, 2), and `spreads`
    the Cholesky factors of the velocities' covariances about these.
    """
    count, size = leads.shape[:2]
    share = (1.0 - PRIOR_SHARE) / count
    # Systematic sampling gives each component its exact share; later indices are the prior.
    component = np.floor((np.arange(size) + rng.random()) / size * (1.0 / share)).astype(np.int64)
    normal = rng.standard_normal((size, 2))
    velocity = births.velocity_std * normal
    for index in range(count):
        rows = np.flatnonzero(component == index)
        velocity[rows] = leads[index, rows] + normal[rows] @ spreads[index].T
    prior = np.exp(-0.5 * (velocity**2).sum(axis=1) / births.velocity_std**2)
    prior /= 2.0 * np.pi * births.velocity_std**2
    mixture = PRIOR_SHARE * prior
    for lead, spread in zip(leads, spreads, strict=True):
        whitened = np.linalg.solve(spread, (velocity - lead).T)
        density = np.exp(-0.5 * (whitened**2).sum(axis=0))
        mixture += share * density / (2.0 * np.pi * np.linalg.det(spread))
    return velocity, prior / mixture
