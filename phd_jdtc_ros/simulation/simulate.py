"""Simulates every radar's detections of a scenario's targets, among clutter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.types import FULL_TURN, Detections, Scan, Truth

from .clutter.echoes import Echoes
from .clutter.law import NOISE, ClutterLaw
from .clutter.reflectors import Reflectors
from .noise import polar, with_noise
from .scenario import Scenario, truth_at


def detect(
    truth: Truth,
    snr: FloatArray,
    radar: RadarModel,
    rng: np.random.Generator,
    law: ClutterLaw = NOISE,
    echoes: Echoes | None = None,
    reflectors: Sequence[Reflectors] = (),
) -> tuple[Detections, IntArray]:
    """Return one radar's detections of `truth` among its clutter, in random order.

    Parameters
    ----------
    truth : Truth
        T targets.
    snr : array of shape (T,)
        Mean signal-to-noise ratio of each target, linear.
    law : ClutterLaw
        Law of the clutter's envelopes.
    echoes : Echoes or None
        Further detections of targets; None for none.
    reflectors : sequence of Reflectors
        Fixed clutter.

    Returns
    -------
    detections : Detections
        M detections.
    source : int array of shape (M,)
        The track_id of each detection's target; 0 for clutter.

    Notes
    -----
    The envelopes of targets are Rayleigh with sigma^2 = 1 + d, and of noise with sigma^2 = 1; only
    envelopes above the radar's threshold are reported. The clutter rate counts reported detections.
    """
    exact = radar.measure(truth.state)
    measurement, envelope, seen = observe(exact, snr, radar, rng)
    clutter, tail = false_detections(radar, rng.poisson(radar.clutter_rate), rng, law)
    state, target = truth.state[seen], truth.track_id[seen]
    measurement, envelope = measurement[seen], envelope[seen]
    if echoes is not None:
        echo, row = echoes.sources(state, truth.space, rng)
        further, level, shown = observe(radar.measure(echo), snr[seen][row], radar, rng)
        state, target = np.concatenate([state, echo[shown]]), np.append(target, target[row[shown]])
        measurement = np.concatenate([measurement, further[shown]])
        envelope = np.append(envelope, level[shown])
    places, high = _reflector_detections(radar, reflectors, rng)
    count = len(clutter) + len(places)
    rate = range_rates(state, count, radar, rng)
    measurement = np.concatenate([measurement, clutter, places])
    order = rng.permutation(len(measurement))
    detections = Detections(
        measurement=measurement[order],
        amplitude=np.concatenate([envelope, tail, high])[order],
        range_rate=None if rate is None else rate[order],
    )
    source = np.concatenate([target, np.zeros(count, dtype=np.int64)])
    return detections, source[order]


def range_rates(
    state: FloatArray, clutter: int, radar: RadarModel, rng: np.random.Generator
) -> FloatArray | None:
    """Return measured range rates of targets and then of clutter; None if the radar has none.

    Parameters
    ----------
    state : array of shape (N, D)
        States of the detected targets, or of the sources of their echoes.
    clutter : int
        Number of false detections.

    Notes
    -----
    Ambiguous range rates are within plus or minus half the ambiguity interval.
    """
    model = radar.range_rate
    if model is None:
        return None
    noisy = radar.range_rate_of(state) + model.std * rng.standard_normal(len(state))
    uniform = model.clutter_width * (rng.random(clutter) - 0.5)
    return np.append(model.wrap(noisy), uniform)


def observe(
    exact: FloatArray, snr: FloatArray, radar: RadarModel, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the measurements of targets, and whether the radar detects each.

    Parameters
    ----------
    exact : array of shape (N, 2)
        True range and azimuth, metres and radians.
    snr : array of shape (N,)
        Mean signal-to-noise ratio, linear.

    Returns
    -------
    measurement : array of shape (N, 2)
        Noisy range and azimuth; ranges are not negative, azimuths are in (-pi, pi].
    envelope : array of shape (N,)
    seen : bool array of shape (N,)

    Notes
    -----
    A target is detected if its envelope exceeds the threshold. If the radar has a detection
    probability, detection follows it, and the envelope is drawn above the threshold.
    """
    visible = radar.visibility.sees(exact) > 0.0
    envelope = rng.rayleigh(np.sqrt(1.0 + snr))
    noisy = with_noise(exact, radar, rng)
    if radar.visibility.given:
        found = rng.random(len(exact)) < radar.visibility.probability(exact[:, 0])
        # Squares of Rayleigh envelopes are exponential, and the exponential law is memoryless.
        envelope = np.sqrt(radar.threshold**2 + envelope**2)
    else:
        found = envelope > radar.threshold
    return noisy, envelope, found & visible


def false_detections(
    radar: RadarModel, count: int, rng: np.random.Generator, law: ClutterLaw
) -> tuple[FloatArray, FloatArray]:
    """Return measurements of clutter, shape (count, 2), and their envelopes, shape (count,).

    Clutter is uniform in the azimuths of the field of view.
    """
    fov = radar.visibility.fov
    # The start of a field of view of a whole turn has no meaning.
    first = -np.pi if fov.width == FULL_TURN else fov.start
    clutter = np.stack(
        [
            rng.uniform(0.0, radar.clutter_max_range, count),
            rng.uniform(first, first + fov.width, count),
        ],
        axis=1,
    )
    return polar(clutter), law.draw(radar.threshold, count, rng)


def _reflector_detections(
    radar: RadarModel, reflectors: Sequence[Reflectors], rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return measurements (K, 2) and envelopes (K,) of the detected reflectors."""
    measurement, amplitude = [np.zeros((0, 2))], [np.zeros(0)]
    for kind in reflectors:
        state = np.zeros((len(kind.points), len(radar.space)))
        state[:, list(radar.space.position)] = kind.points
        found = kind.measure(radar.measure(state), radar, rng)
        measurement.append(found.measurement[found.seen])
        amplitude.append(found.amplitude[found.seen])
    return np.concatenate(measurement), np.concatenate(amplitude)


def simulate(scenario: Scenario, seed: int) -> list[tuple[Truth, Scan]]:
    """Return the truth and the scan of every stamp; reproducible by the seed."""
    return [(truth, scan) for truth, scan, _ in simulate_with_sources(scenario, seed)]


def simulate_with_sources(
    scenario: Scenario, seed: int
) -> list[tuple[Truth, Scan, tuple[IntArray, ...]]]:
    """Return the result of `simulate` with the source of each detection for every radar."""
    rng = np.random.default_rng(seed)
    snr_of = np.array([target.snr for target in scenario.targets])
    run = []
    for index in range(scenario.scans):
        truth = truth_at(scenario, index)
        elapsed_s = index * scenario.interval_s
        reports = [
            detect(
                truth,
                snr_of[truth.track_id - 1],
                scenario.radar_at(number, elapsed_s),
                rng,
                *scenario.clutter_and_echoes(number),
                scenario.reflectors,
            )
            for number in range(len(scenario.radars))
        ]
        found = (
            scenario.with_replies(
                *(detections, source, np.full(len(source), elapsed_s)), (seed, index, number)
            )
            for number, (detections, source) in enumerate(reports)
        )
        scan = Scan(truth.stamp_ns, tuple(found))
        run.append((truth, scan, tuple(source for _, source in reports)))
    return run
