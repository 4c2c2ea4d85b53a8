"""What the sensors of a scan could show of a target, by its density.

The probability that all sensors miss a target is an integral over its density. A density much wider
than the noise is not resolved: a detection among the many in its gates says little about it. With
maps of clutter a target that is stationary is clutter to the sensors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import FloatArray
from ..models.tracker_model import TrackerModel
from ..sensors.view import View
from ..targets import stationary
from ..targets.amplitude_density import of_classes
from ..types import Estimates, Scan


def missed_and_spread(
    estimates: Estimates, scan: Scan, model: TrackerModel, views: Sequence[View]
) -> tuple[FloatArray, FloatArray]:
    """Return the probability that no sensor of a scan detects each target, and its spread, (T,).

    The probability depends on the target's class, and on its density at the sensors' poses at the
    scan: what of it is outside the coverage is not missed, and nothing is if most of it is outside.
    The spread is the geometric mean, over the components of a measurement, of the density's
    standard deviation in standard deviations of the noise. It is that by the sensor for which it is
    smallest, in the scan or not: a lidar that reports other places makes no radar's track wide.
    """
    missed = np.ones(len(estimates))
    spread = missed * np.nan
    for view, report in zip(views, scan.detections, strict=True):
        sensor = view.sensor if report is None else view.sensor.at(report.pose)
        gaussians = estimates.state[:, None], estimates.covariance[:, None]
        expected = sensor.of_gaussians.expected(*gaussians)
        measured, std = expected.measured[:, 0], expected.std[:, 0]
        area = np.multiply.reduce(std / sensor.noise_std, axis=1)
        spread = np.fmin(spread, area ** (1.0 / len(sensor.noise_std)))
        if report is None:
            continue
        detected = sensor.visibility.detection_probability(measured, std)
        if detected is None:
            detected = of_classes(sensor.threshold, model.modes.classes)[estimates.class_id]
        detected = view.detection_probability_at(detected, measured)
        covered = sensor.visibility.coverage_probability(
            measured, report.coverage, sensor.noise_std, std
        )
        # Share of a density that is covered at least where its target counts as covered.
        least_covered = 0.5
        missed *= 1.0 - np.where(covered < least_covered, 0.0, covered) * detected
    return missed, spread


def stationary_speed(views: Sequence[View]) -> float:
    """Return the speed below which a target is clutter to every sensor, m/s; 0 if there is none.

    To a sensor without a map of clutter, or whose `clutter_map_speed` is 0, no target is clutter.
    """
    maps = [view.fixed_clutter for view in views]
    return min([0.0 if each is None else each.speed for each in maps], default=0.0)


def stationary_probability(
    estimates: Estimates, model: TrackerModel, views: Sequence[View]
) -> FloatArray:
    """Return the probability that each target is stationary, and so clutter to all sensors, (T,).

    It is 0 if a sensor has no clutter map, or tracks stationary targets. While the velocity is
    unknown it is one half away from fixed clutter, see `stationary`, and larger among fixed
    clutter: the odds are divided by the probability that the neighbourhood has none.
    """
    bound = stationary_speed(views)
    if bound == 0.0:
        return np.zeros(len(estimates))
    covariance = estimates.velocity_covariance
    slower = stationary.probability_slower(estimates.velocity, covariance, bound)
    without_reflectors = model.detection_births.stationary(slower, bound)
    return stationary.among_reflectors(without_reflectors, _among_reflectors(estimates, views))


def _among_reflectors(estimates: Estimates, views: Sequence[View]) -> FloatArray:
    """Return the probability that all sensors have fixed clutter around each target, (T,).

    Only sensors that see the place count; 0 if none does.
    """
    excess = []
    for view in views:
        if (clutter := view.fixed_clutter) is None:
            excess.append(np.zeros(len(estimates)))
        else:
            measured = view.sensor.measure(estimates.state)
            excess.append(clutter.around(view, measured, estimates.position))
    smallest = np.min(excess, axis=0)
    return stationary.among_fixed_clutter(np.where(np.isinf(smallest), 0.0, smallest))
