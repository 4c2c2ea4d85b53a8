"""Simulates every radar's detections of a scenario's targets, among clutter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.spatial_radar import SpatialRadar
from phd_jdtc_ros.core.sensors.visibility import Visibility
from phd_jdtc_ros.core.types import FULL_TURN, Detections, Scan, Truth

from .antenna import Observation, polar, with_noise
from .clutter import NOISE, ClutterLaw, Echoes, Reflectors
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
    """Return one radar's detections of `truth` and its clutter, in random order, and their sources.

    `snr`, shape (T,), has the mean signal-to-noise ratio of each target, linear. A source is the
    track_id of the target, 0 for clutter.

    The envelopes of targets are Rayleigh with sigma^2 = 1 + d, and of noise with sigma^2 = 1; only
    envelopes above the radar's threshold are reported. The clutter rate counts reported detections,
    and those that a blind sector hides.
    """
    states = states_for(radar, truth)
    observed = observe(radar.measure(states), snr, radar, rng)
    clutter = false_detections(radar, rng.poisson(radar.clutter_rate), rng, law)
    if radar.visibility.blind:
        clear = radar.visibility.probability_in_view(clutter[0]) > 0.0
        clutter = clutter[0][clear], clutter[1][clear]
    state, target = states[observed.seen], truth.track_id[observed.seen]
    parts = [observed.detected]
    if echoes is not None:
        echo, row = echoes.sources(state, truth.space, rng)
        further = observe(radar.measure(echo), snr[observed.seen][row], radar, rng)
        state = np.concatenate([state, echo[further.seen]])
        target = np.append(target, target[row[further.seen]])
        parts.append(further.detected)
    parts.append(clutter)
    for kind in reflectors:
        fixed = np.zeros((len(kind.points), len(radar.space)))
        fixed[:, list(radar.space.position)] = kind.points
        parts.append(kind.measure(radar.measure(fixed), radar, rng).detected)
    measurement, amplitude = map(np.concatenate, zip(*parts, strict=True))
    false = len(measurement) - len(target)
    found = Detections(measurement, amplitude, range_rate=range_rates(state, false, radar, rng))
    source = np.append(target, np.zeros(false, dtype=np.int64))
    order = rng.permutation(len(source))
    return found.take(order), source[order]


def states_for(radar: RadarModel, truth: Truth) -> FloatArray:
    """Return the states of targets with the axes that a radar measures, (T, D)."""
    vertical = list(radar.space.vertical)
    if not vertical:
        return truth.state
    states = np.zeros((len(truth.state), len(radar.space)))
    states[:, : truth.state.shape[1]] = truth.state
    states[:, vertical] = 0.0 if truth.height is None else truth.height
    return states


def range_rates(
    state: FloatArray, clutter: int, radar: RadarModel, rng: np.random.Generator
) -> FloatArray | None:
    """Return measured range rates of targets and then of clutter; None if the radar has none.

    `state`, shape (N, D), has the states of the detected targets, or of the sources of their
    echoes; `clutter` is the number of false detections. Ambiguous range rates are within plus
    or minus half the ambiguity interval.
    """
    model = radar.range_rate
    if model is None:
        return None
    noisy = radar.range_rate_of(state) + model.std * rng.standard_normal(len(state))
    uniform = model.clutter_width * (rng.random(clutter) - 0.5)
    return np.append(model.wrap(noisy), uniform)


def observe(
    exact: FloatArray, snr: FloatArray, radar: RadarModel, rng: np.random.Generator
) -> Observation:
    """Return the measurements of targets with these true ones, (N, Z), metres and radians.

    `snr`, shape (N,), has mean signal-to-noise ratios, linear. A target is detected if its
    envelope exceeds the threshold. If the radar has a detection probability, detection follows
    it, and the envelope is drawn above the threshold.
    """
    visible = radar.visibility.probability_in_view(exact) > 0.0
    envelope = rng.rayleigh(np.sqrt(1.0 + snr))
    noisy = with_noise(exact, radar, rng)
    if radar.visibility.probabilities:
        found = rng.random(len(exact)) < radar.visibility.probability(exact[:, 0])
        # Squares of Rayleigh envelopes are exponential, and the exponential law is memoryless.
        envelope = np.sqrt(radar.threshold**2 + envelope**2)
    else:
        found = envelope > radar.threshold
    return Observation(noisy, envelope, found & visible)


def false_detections(
    radar: RadarModel, count: int, rng: np.random.Generator, law: ClutterLaw
) -> tuple[FloatArray, FloatArray]:
    """Return measurements of clutter, shape (count, Z), and their envelopes, shape (count,).

    Clutter is uniform in the azimuths of the field of view, and in space uniform on the sphere
    between its elevations. Its ranges have the radar's density.
    """
    fov = radar.visibility.fov
    # The start of a field of view of a whole revolution has no meaning.
    first = -np.pi if fov.width == FULL_TURN else fov.start
    distance = _with_density(
        radar.visibility, rng.uniform(0.0, radar.visibility.clutter_range, count)
    )
    azimuth = rng.uniform(first, first + fov.width, count)
    columns = [distance, azimuth]
    if isinstance(radar, SpatialRadar):
        low, high = np.sin(radar.visibility.elevation_limits)
        columns.append(np.arcsin(rng.uniform(low, high, count)))
    return polar(np.stack(columns, axis=1)), law.draw(radar.threshold, count, rng)


def _with_density(visibility: Visibility, uniform: FloatArray) -> FloatArray:
    """Return uniform ranges of clutter moved to where its density has the same integral, (N,).

    The density is that of the ranges at which the radar reports; those below stay as they are.
    """
    near, far = visibility.min_range, visibility.clutter_range
    if not visibility.clutter_density or near >= far:
        return uniform
    given = np.array(visibility.clutter_ranges)
    edges = np.concatenate([[near], given[(given > near) & (given < far)], [far]])
    level = np.interp(edges, given, visibility.clutter_density)
    integral = np.append(0.0, np.cumsum(0.5 * (level[1:] + level[:-1]) * np.diff(edges)))
    wanted = np.maximum(uniform - near, 0.0) / (far - near) * integral[-1]
    part = np.minimum(np.searchsorted(integral, wanted, side="right"), len(edges) - 1) - 1
    slope, rest = np.diff(level)[part] / np.diff(edges)[part], wanted - integral[part]
    # The root of a linear density's integral, in the form that also holds without a slope.
    root = np.sqrt(np.maximum(level[part] ** 2 + 2.0 * slope * rest, 0.0))
    moved: FloatArray = edges[part] + 2.0 * rest / (level[part] + root)
    return np.where(uniform < near, uniform, moved)


def simulate(scenario: Scenario, seed: int) -> list[tuple[Truth, Scan]]:
    """Return the truth and the scan of every stamp; reproducible by the seed."""
    return [(truth, scan) for truth, scan, _ in simulate_with_sources(scenario, seed)]


def simulate_with_sources(
    scenario: Scenario, seed: int
) -> list[tuple[Truth, Scan, tuple[IntArray, ...]]]:
    """Return the result of `simulate` with the source of each detection for every radar."""
    rng = np.random.default_rng(seed)
    run = []
    radars = range(len(scenario.radars))
    for index in range(scenario.scans):
        truth = truth_at(scenario, index)
        reports = [detect_scan(scenario, truth, index, radar, rng) for radar in radars]
        found = (
            scan_replies(scenario, *report, index, radar, seed)
            for radar, report in enumerate(reports)
        )
        scan = Scan(truth.stamp_ns, tuple(found))
        run.append((truth, scan, tuple(source for _, source in reports)))
    return run


def detect_scan(
    scenario: Scenario, truth: Truth, scan: int, radar: int, rng: np.random.Generator
) -> tuple[Detections, IntArray]:
    """Return the detections of a staring radar at a scan without replies, and their sources."""
    snr = np.array([target.snr for target in scenario.targets])[truth.track_id - 1]
    model = scenario.radar_at(radar, scan * scenario.interval_s)
    echoes = scenario.echoes[radar] if scenario.echoes else None
    return detect(truth, snr, model, rng, scenario.law(radar), echoes, scenario.reflectors)


def scan_replies(
    scenario: Scenario, found: Detections, source: IntArray, scan: int, radar: int, seed: int
) -> Detections:
    """Return the detections of a scan with their targets' replies."""
    time_s = np.full(len(source), scan * scenario.interval_s)
    found = scenario.with_replies(found, source, time_s, (seed, scan, radar))
    if scenario.radars[radar].space.vertical:
        return found.changed(height=None, z=found.height)
    return found
