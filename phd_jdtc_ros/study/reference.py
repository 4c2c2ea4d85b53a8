# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The model-matched reference: what smoothing can gain when the association is known.

One iterated extended Kalman filter per true target, with the motion model, the radars and the
prior of a birth that the tracker has, and a Rauch-Tung-Striebel smoother over a fixed lag. It is
told which detection is whose, when a target lives and of which class it is, so its error is
localisation alone: a tracker of the same model can come close to it and hardly below.

The state is ``[x, vx, y, vy]``, the support of the constant-velocity model: D = 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.evaluation import PointSet
from phd_jdtc_ros.core.motion import POSITION, STATE_SIZE, VELOCITY, ConstantVelocity, MotionModel
from phd_jdtc_ros.core.radar import RadarModel, wrap_angle
from phd_jdtc_ros.core.types import FloatArray

from .runs import SimulatedRun, Tracks

# Gauss-Newton steps of one measurement update; two or three suffice but for targets next to the
# radar.
ITERATIONS = 10
CONVERGED_M = 1e-3


@dataclass(frozen=True)
class Gaussian:
    """A normal distribution.

    Parameters
    ----------
    mean : array of shape (D,)
    covariance : array of shape (D, D)
    """

    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class Filtered:
    """What the filter leaves of one scan, and what the smoother needs of it.

    Parameters
    ----------
    transition : array of shape (D, D)
        F from the scan before.
    predicted : Gaussian
        Before the scan's measurements; the prior on a target's first scan.
    updated : Gaussian
        After them.
    """

    transition: FloatArray
    predicted: Gaussian
    updated: Gaussian


def transition_matrix(model: MotionModel, dt: float) -> FloatArray:
    """Return F(dt) of a linear motion model on its support, shape (D, D)."""
    support = list(model.support)
    matrix: FloatArray = model.mean(np.eye(STATE_SIZE), dt).T[np.ix_(support, support)]
    return matrix


def predict(before: Gaussian, transition: FloatArray, noise: FloatArray) -> Gaussian:
    """Return the distribution of ``F x + v``, v of covariance `noise`; both of shape (D, D)."""
    return Gaussian(
        transition @ before.mean,
        transition @ before.covariance @ transition.T + noise,
    )


def update(
    prior: Gaussian,
    radar: RadarModel,
    measurement: FloatArray,
    support: tuple[int, ...],
    iterations: int = ITERATIONS,
) -> Gaussian:
    """Return the posterior of one polar measurement by an iterated extended Kalman filter.

    Parameters
    ----------
    prior : Gaussian
    radar : RadarModel
    measurement : array of shape (2,)
        Range in metres, azimuth in radians in the radar's frame; its innovation is wrapped.
    support : tuple of D int
        Where the components of the Gaussian lie in the state.
    iterations : int
        At most this many linearisations; 1 is the plain extended filter.

    References
    ----------
    Bell and Cathey, "The iterated Kalman filter update as a Gauss-Newton method", IEEE
    Transactions on Automatic Control 38(2), 1993.
    """
    noise = np.diag(radar.noise_std**2)
    at = prior.mean
    for _ in range(iterations):
        expected, jacobian = _linearised(radar, at, support)
        innovation = measurement - expected
        innovation[1] = wrap_angle(innovation[1])
        spread = jacobian @ prior.covariance @ jacobian.T + noise
        gain = np.linalg.solve(spread, jacobian @ prior.covariance).T
        previous, at = at, prior.mean + gain @ (innovation - jacobian @ (prior.mean - at))
        if np.abs(at - previous).max() < CONVERGED_M:
            break
    # Joseph's form stays symmetric and positive.
    kept = np.eye(len(at)) - gain @ jacobian
    return Gaussian(at, kept @ prior.covariance @ kept.T + gain @ noise @ gain.T)


def _linearised(
    radar: RadarModel, mean: FloatArray, support: tuple[int, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return (range, azimuth) at a mean, shape (2,), and their derivatives, shape (2, D)."""
    state = np.zeros((1, STATE_SIZE))
    state[0, list(support)] = mean
    expected = radar.measure(state)[0]
    east, north = state[0, list(POSITION)] - radar.position
    distance = expected[0]
    full = np.zeros((2, STATE_SIZE))
    full[0, list(POSITION)] = np.array([east, north]) / distance
    full[1, list(POSITION)] = np.array([-north, east]) / distance**2
    return expected, full[:, list(support)]


def smooth(filtered: Sequence[Filtered]) -> Gaussian:
    """Return the first scan's distribution given the measurements of all of them.

    Parameters
    ----------
    filtered : sequence of Filtered
        Consecutive scans of one target; of a single one, its filtered distribution is returned.

    References
    ----------
    Rauch, Tung and Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA
    Journal 3(8), 1965.
    """
    later = filtered[-1].updated
    for here, ahead in zip(filtered[-2::-1], filtered[:0:-1], strict=True):
        # G = P F' P_predicted^-1
        gain = np.linalg.solve(
            ahead.predicted.covariance, ahead.transition @ here.updated.covariance
        ).T
        correction = later.covariance - ahead.predicted.covariance
        later = Gaussian(
            here.updated.mean + gain @ (later.mean - ahead.predicted.mean),
            here.updated.covariance + gain @ correction @ gain.T,
        )
    return later


def birth(
    state: FloatArray, support: tuple[int, ...], position_std: float, velocity_std: float
) -> Gaussian:
    """Return the prior of a target that is born at a state's position, at rest on average.

    Parameters
    ----------
    state : array of shape (5,)
    support : tuple of D int
    position_std, velocity_std : float
        An axis, in metres and metres per second.
    """
    mean, std = np.zeros(STATE_SIZE), np.zeros(STATE_SIZE)
    mean[list(POSITION)] = state[list(POSITION)]
    std[list(POSITION)], std[list(VELOCITY)] = position_std, velocity_std
    return Gaussian(mean[list(support)], np.diag(std[list(support)] ** 2))


def filter_target(
    run: SimulatedRun, track_id: int, prior: Gaussian, model: MotionModel
) -> dict[int, Filtered]:
    """Return the filtered distributions of one target, by the index of the scan.

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
    The radars update in turn, in the order of the scenario, as the tracker's do.
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
    """Return the estimates of a tracker that knows which detection belongs to which target.

    Parameters
    ----------
    run : SimulatedRun
    lags : sequence of int
        Scans; 0 is the filter. The last scans of a target's life have as many later ones as
        there are.
    noise_density : float
        Spectral density l of the constant-velocity model, m^2/s^3.
    position_std, velocity_std : float
        Spread of the prior about the true first position and about rest, m and m/s; the defaults
        are those of the reference scenario's births.

    Returns
    -------
    dict of lag to list of PointSet
        One a scan, with exactly the targets that live and their true classes, in the order of
        the truth.
    """
    model = ConstantVelocity(noise_density)
    place = [model.support.index(axis) for axis in POSITION]
    first = {
        int(number): state
        for truth in reversed(run.truth)
        for number, state in zip(truth.track_id, truth.state, strict=True)
    }
    targets = {
        number: filter_target(
            run, number, birth(state, model.support, position_std, velocity_std), model
        )
        for number, state in first.items()
    }

    def estimate(index: int, number: int, lag: int) -> FloatArray:
        alive = targets[number]
        seen = [alive[i] for i in range(index, index + lag + 1) if i in alive]
        return smooth(seen).mean[place]

    tracks: dict[int, list[PointSet]] = {}
    for lag in lags:
        tracks[lag] = []
        for index, truth in enumerate(run.truth):
            rows = [estimate(index, int(number), lag) for number in truth.track_id]
            position = np.array(rows, dtype=np.float64).reshape(-1, len(place))
            tracks[lag].append(PointSet(position, truth.class_id))
    return tracks
