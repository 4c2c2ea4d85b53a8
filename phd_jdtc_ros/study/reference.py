# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The model-matched reference: filter and smoother with known association.

It runs one iterated extended Kalman filter per true target, with the tracker's motion model, radars
and birth prior, and a Rauch-Tung-Striebel smoother over a fixed lag. It is given the association,
the lifetime and the class of every target, so its only error is localisation. A tracker of the
same model can approach this error but hardly fall below it.

The state is ``[x, vx, y, vy]``, the support of the constant-velocity model: D = 4.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.evaluation.scan_scores import PointSet
from phd_jdtc_ros.core.gaussian.ekf import Gaussian, predict, transition_matrix, update
from phd_jdtc_ros.core.gaussian.rts import Filtered, smooth
from phd_jdtc_ros.core.models.motion import ConstantVelocity, MotionModel

from .runs import SimulatedRun, Tracks


def birth(
    position: FloatArray, motion: MotionModel, position_std: float, velocity_std: float
) -> Gaussian:
    """Return the prior of a target born at a position, with zero mean velocity.

    Parameters
    ----------
    position : array of shape (2,)
        World frame, metres.
    motion : MotionModel
    position_std, velocity_std : float
        Along each axis, in metres and metres per second.
    """
    support = list(motion.support)
    mean = motion.space.state(position, 0.0, 0.0)
    std = motion.space.state(position_std, velocity_std, 0.0)
    return Gaussian(mean[support], np.diag(std[support] ** 2))


def filter_target(
    run: SimulatedRun, track_id: int, prior: Gaussian, model: MotionModel
) -> dict[int, Filtered]:
    """Return the filtered distributions of one target, by scan index.

    Parameters
    ----------
    run : SimulatedRun
    track_id : int
    prior : Gaussian
        At the target's first scan, before its measurements.
    model : MotionModel
        A linear one.

    Notes
    -----
    Radars update one after the other in the order of the scenario, as in the tracker.
    """
    result: dict[int, Filtered] = {}
    previous = -1
    for index, (truth, scan) in enumerate(zip(run.truth, run.scans, strict=True)):
        if track_id not in truth.track_id:
            continue
        transition, predicted = np.eye(len(prior.mean)), prior
        if result:
            dt = 1e-9 * (truth.stamp_ns - run.truth[previous].stamp_ns)
            transition = transition_matrix(model, dt)
            noise = model.noise_covariance(dt)
            predicted = predict(result[previous].updated, transition, noise)
        updated = predicted
        for radar, report, source in zip(
            run.scenario.radars, scan.detections, run.sources[index], strict=True
        ):
            if report is None:
                continue
            for measurement in report.measurement[source == track_id]:
                updated = update(updated, radar, measurement, model.support)
        result[index] = Filtered(transition, predicted, updated)
        previous = index
    return result


def known_association(
    run: SimulatedRun,
    lags: Sequence[int],
    noise_density: float = 1.0,
    position_std: float = 200.0,
    velocity_std: float = 40.0,
) -> Tracks:
    """Return the estimates of a tracker that knows the source of every detection.

    Parameters
    ----------
    run : SimulatedRun
    lags : sequence of int
        Scans; 0 is the filter. Near the end of a target's life fewer later scans are used.
    noise_density : float
        Spectral density l of the constant-velocity model, m^2/s^3.
    position_std, velocity_std : float
        Standard deviations of the prior about the true first position and about zero velocity,
        m and m/s; the defaults are those of the reference scenario's births.

    Returns
    -------
    dict of lag to list of PointSet
        One set per scan, with the true number of targets and their true classes, in the order of
        the truth.
    """
    model = ConstantVelocity(noise_density)
    position_index = [model.support.index(axis) for axis in model.space.position]
    first = {
        int(number): position
        for truth in reversed(run.truth)
        for number, position in zip(truth.track_id, truth.position, strict=True)
    }
    targets = {
        number: filter_target(
            run, number, birth(position, model, position_std, velocity_std), model
        )
        for number, position in first.items()
    }

    def estimate(index: int, number: int, lag: int) -> FloatArray:
        alive = targets[number]
        seen = [alive[i] for i in range(index, index + lag + 1) if i in alive]
        return smooth(seen).mean[position_index]

    tracks: dict[int, list[PointSet]] = {}
    for lag in lags:
        tracks[lag] = []
        for index, truth in enumerate(run.truth):
            rows = [estimate(index, int(number), lag) for number in truth.track_id]
            position = np.array(rows, dtype=np.float64).reshape(-1, len(position_index))
            tracks[lag].append(PointSet(position, truth.class_id))
    return tracks
