"""The correction by one radar's detections (Sec. IV-C, Step 2), of particles.

What particles and Gaussians have in common is here: p_D of a target, and the share of each target
in each detection. Several radars correct in turn (the iterated corrector), which the paper leaves
open.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ..arrays import FloatArray, IntArray, sum_by
from ..factors.limit import limit_detections
from ..sensors.polar_radar import polar_radars
from ..sensors.view import View
from ..targets.amplitude_density import of_classes
from ..targets.modes import ModeSpace
from .particles import Particles


def detection_probability(
    report: View,
    measured: FloatArray,
    class_id: IntArray,
    modes: ModeSpace,
    std: FloatArray | None = None,
) -> FloatArray:
    """Return p_D of a target at each row, (N,); 0 outside the sensor's field of view.

    Deviation: the printed p_D depends on the amplitude; it is a function of the class and the
    threshold alone. `measured` and `std`, (N, Z), have the expected measurements and their
    standard deviations without the sensor's noise; None if the states are certain.
    """
    sensor = report.sensor
    detected = sensor.visibility.detection_probability(measured, std)
    if detected is None:
        detected = of_classes(sensor.threshold, modes.classes)[class_id]
    return detected * sensor.visibility.probability_in_view(measured, std) * report.share


def log_amplitude_likelihood(
    report: View, class_id: IntArray, column: IntArray, modes: ModeSpace
) -> FloatArray:
    """Return log p_D g^tau(a) of pairs of a target's class and a detection, (P,)."""
    return report.log_class_likelihood(modes.classes)[class_id, column]


def explained_shares(
    column: IntArray, log_likelihood: FloatArray, weight: FloatArray, report: View
) -> FloatArray:
    """Return the share of each pair in its detection, (P,): p_D L w / (kappa + Psi).

    `column`, `log_likelihood` and `weight` have the detection of each pair, log p_D L, and the
    weight of its target, (P,). Psi is the sum of p_D L w over all classes.
    """
    # The clutter's amplitude density underflows above an amplitude of 38. Therefore kappa and p_D L
    # are divided by the largest of them, for each detection.
    scale: FloatArray = report.log_clutter.copy()
    np.maximum.at(scale, column, log_likelihood)
    mass = weight * np.exp(log_likelihood - scale[column])
    total = np.exp(report.log_clutter - scale) + sum_by(column, mass, len(report))
    share: FloatArray = mass / total[column]
    return share


def correct(particles: Particles, report: View, modes: ModeSpace) -> Particles:
    """Return the particles after a report; each of its detections becomes a component.

    Sec. IV-C, Step 2: w [1 - p_D + sum over z of p_D L_z / (kappa(z) + Psi(z))], with the term of
    each detection kept apart.
    """
    class_id = modes.class_of[particles.mode]
    measured = report.sensor.measure(particles.state)
    report = limit_detections(report, measured, particles.weight)
    (radar,) = polar_radars([report.sensor])
    # A target outside the field of view is no source of a detection inside it.
    (visible,) = radar.visibility.probability_in_view(measured).nonzero()
    row, column, log_likelihood = radar.gated_pairs(measured[visible], report.detections)
    row = visible[row]
    log_likelihood = log_likelihood + log_amplitude_likelihood(report, class_id[row], column, modes)
    share = explained_shares(column, log_likelihood, particles.weight[row], report)
    missed = 1.0 - detection_probability(report, measured, class_id, modes)
    shape = len(particles), len(report)
    return particles.explained_by(missed, sparse.csr_array((share, (row, column)), shape=shape))
