"""The model-matched reference: filter and smoother with known association.

It runs one iterated extended Kalman filter per true target, with the tracker's motion model, radars
and birth prior, and a Rauch-Tung-Striebel smoother over a fixed lag. It is given the association,
the lifetime and the class of every target, so its only error is localisation. A tracker with the
same model can approach this error but hardly fall below it. A tracker with another model can: most
scenarios' targets fly straight, without the process noise of the model.

A single target with one motion model is the case N = 1 of the functions in `kalman`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.gaussian.algebra import kalman
from phd_jdtc_ros.core.sensors.of_gaussians.linearised import Measured, WeightedGaussians
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.targets.motion import ConstantVelocity, MotionModel
from phd_jdtc_ros.evaluation.comparison import PointSet

from .tracker import SimulatedRun, Tracks

# Largest number of linearisations and their convergence: strict, because the reference must add no
# error of its own and one target costs little.
ITERATIONS, CONVERGED = 10, 1e-5
# Spectral density of the acceleration for straight flight, m^2/s^3: the best, and smallest, of the
# values 0.001 to 10 on seeds 9000 to 9009 of the scenarios without turns.
BEST_NOISE = 0.001


@dataclass(frozen=True)
class Gaussian:
    """A normal distribution of a state."""

    mean: FloatArray  # (D,)
    covariance: FloatArray  # Zero on axes on which the motion is not defined, (D, D)


@dataclass(frozen=True)
class Backward:
    """The backward step from a later distribution to the earlier one."""

    before: Gaussian  # The filtered distribution
    predicted: Gaussian  # Its prediction
    gain: FloatArray  # (D, D)

    def earlier(self, later: Gaussian) -> Gaussian:
        """Return the earlier distribution, given the later one.

        References
        ----------
        Rauch, Tung and Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA
        Journal 3(8), 1965.
        """
        gain, apart = self.gain, later.covariance - self.predicted.covariance
        return Gaussian(
            self.before.mean + gain @ (later.mean - self.predicted.mean),
            self.before.covariance + gain @ apart @ gain.T,
        )


@dataclass(frozen=True)
class FilterStep:
    """The filter's result for one scan, for use by the smoother."""

    updated: Gaussian  # Distribution after the scan's measurements
    # Backward step from this scan to the target's previous one; None on its first scan.
    back: Backward | None


def birth(
    position: FloatArray, motion: MotionModel, position_std: float, velocity_std: float
) -> Gaussian:
    """Return the prior of a target born at a position, metres, (2,), with zero mean velocity.

    The standard deviations are along each axis, metres and metres per second.
    """
    std = motion.space.state(position_std, velocity_std, 0.0)
    return Gaussian(motion.space.state(position, 0.0, 0.0), np.diag(std**2))


def predict(before: Gaussian, motion: MotionModel, dt: float) -> tuple[Gaussian, Backward]:
    """Return the distribution `dt` seconds later, and the backward step from it."""
    size, axes = len(motion.space), list(motion.support)
    state = before.mean[None]
    later_mean, jacobian = motion.mean(state, dt)[0], motion.jacobian(state, dt)[0]
    noise, gain = np.zeros((size, size)), np.zeros((size, size))
    noise[np.ix_(axes, axes)] = motion.noise_covariance(dt)
    cross = before.covariance @ jacobian.T
    later = kalman.symmetric(jacobian @ cross + noise)
    gain[:, axes] = np.linalg.solve(later[np.ix_(axes, axes)], cross[:, axes].T).T
    return Gaussian(later_mean, later), Backward(before, Gaussian(later_mean, later), gain)


def update(
    prior: Gaussian, radar: RadarModel, measurement: FloatArray, iterations: int = ITERATIONS
) -> Gaussian:
    """Return the posterior of one measurement in the radar's frame, metres and radians, (2,).

    It is linearised at most `iterations` times; once is the plain extended Kalman filter.
    """
    state = prior.mean[None], prior.covariance[None]
    found = kalman.innovations(
        WeightedGaussians.of(*state),
        radar,
        Measured(measurement[None], radar.noise_std[None]),
        iterations=iterations,
        converged=CONVERGED,
    )
    mean, covariance = kalman.update(*state, radar, found)
    return Gaussian(mean[0], covariance[0])


def smooth(filtered: Sequence[FilterStep]) -> Gaussian:
    """Return the first scan's distribution given the measurements of all consecutive scans."""
    smoothed = filtered[-1].updated
    for step in filtered[:0:-1]:
        if step.back is None:
            raise ValueError("filtered: a scan after the first has no backward step")
        smoothed = step.back.earlier(smoothed)
    return smoothed


def filter_target(
    run: SimulatedRun, track_id: int, prior: Gaussian, model: MotionModel
) -> dict[int, FilterStep]:
    """Return the filtered distributions of one target, by scan index.

    `prior` is the distribution at the target's first scan, before its measurements. Radars update
    one after the other in the order of the scenario, as in the tracker.
    """
    result: dict[int, FilterStep] = {}
    previous = -1
    for index, (truth, scan) in enumerate(zip(run.truth, run.scans, strict=True)):
        if track_id not in truth.track_id:
            continue
        updated, back = prior, None
        if result:
            dt = 1e-9 * (truth.stamp_ns - run.truth[previous].stamp_ns)
            updated, back = predict(result[previous].updated, model, dt)
        for radar, report, source in zip(
            run.scenario.radars, scan.detections, run.sources[index], strict=True
        ):
            if report is None:
                continue
            for measurement in report.measurement[source == track_id]:
                updated = update(updated, radar, measurement)
        result[index] = FilterStep(updated, back)
        previous = index
    return result


def known_association(run: SimulatedRun, lags: Sequence[int], noise_density: float = 1.0) -> Tracks:
    """Return the estimates of a tracker that knows the source of every detection.

    Lags are in scans; 0 is the filter. Near the end of a target's life fewer later scans are used.
    `noise_density` is the spectral density l of the constant-velocity model, m^2/s^3. The prior of
    a target is about its true first position and about zero velocity.

    The set of a scan has the true number of targets and their true classes, in the truth's order.
    """
    model = ConstantVelocity(noise_density)
    place = list(model.space.position)
    first = {
        int(number): position
        for truth in reversed(run.truth)
        for number, position in zip(truth.track_id, truth.position, strict=True)
    }
    # Standard deviations of a birth in the reference scenario, m and m/s.
    targets = {
        number: filter_target(run, number, birth(position, model, 200.0, 40.0), model)
        for number, position in first.items()
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
