"""Scans of very many detections, with births from detections: their cost, and their effect.

Every case runs in its own process, so that the measured memory is the tracker's.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from msg_adapters.incoming.detections import OWN_LAYOUT, from_msg, to_msg
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel, polar_radars
from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.evaluation.metrics import ospa
from phd_jdtc_ros.parameter_files import from_arguments

from ..harness import scans
from ..harness.figures import Found, in_own_process, measures, peak_mb

DETECTIONS = 100_000
CROWDED, CROWDS, LAST = 16, 2, 28
CUTOFF, ORDER = 1000.0, 2.0
# Several seeds, because the mean distance over the few scans afterwards varies by a tenth.
SEEDS = 3
# A jammed radar reports noise; equal high amplitudes look like targets.
AMPLITUDES = ("noise", "equal", "none")
HIGH = 30.0


@measures(
    "scans of very many detections",
    "2 scans of 100,000: at most 5 s of CPU and 1 GB each; OSPA of the scans from the second after "
    "them within 10 %",
)
def measure(
    detections: int = DETECTIONS, seeds: int = SEEDS, kinds: Sequence[str] = AMPLITUDES
) -> Found:
    """Track the reference scenario with two crowded scans of both radars in its middle."""
    found = {kind: in_own_process(of_case, detections, kind, seeds) for kind in kinds}
    step_s, peak, ratio = (
        max(run[key] for run in found.values()) for key in ("step_s", "peak_mb", "ratio")
    )
    text = (
        f"{detections:,} of both radars in {CROWDS} scans, the worst of {len(kinds)} kinds: "
        f"{step_s:.1f} s of CPU, {peak:.0f} MB; OSPA afterwards {ratio:.3f} times that without"
    )
    return text, step_s <= 5.0 and peak <= 1000.0 and ratio <= 1.1, found


def crowd(
    radar: RadarModel, count: int, amplitudes: str, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return positions anywhere in a radar's field, (M, 2), and amplitudes, (M,)."""
    measurement = np.stack(
        [rng.uniform(0.0, radar.max_range, count), rng.uniform(-np.pi, np.pi, count)], axis=1
    )
    noise = np.sqrt(radar.threshold**2 + 2.0 * rng.standard_exponential(count))
    return measurement, np.full(count, HIGH) if amplitudes == "equal" else noise


def _fill(
    given: Detections, radar: RadarModel, count: int, amplitudes: str, rng: np.random.Generator
) -> Detections:
    """Return a report filled up to `count` detections, decoded from a message."""
    measurement, amplitude = crowd(radar, count, amplitudes, rng)
    joined = Detections(
        np.concatenate([given.measurement, measurement])[:count],
        np.concatenate([given.amplitude, amplitude])[:count],
    )
    return from_msg(to_msg(joined, 1, ""), OWN_LAYOUT).detections


def _run(detections: int, amplitudes: str, seed: int) -> tuple[float, float]:
    """Return the most CPU time of a crowded scan, and the mean OSPA of the scans after them."""
    amplitude = "none" if amplitudes == "none" else "band"
    config = from_arguments.config_of(
        {**from_arguments.load(scans.PROFILE), "amplitude": amplitude}
    )
    tracker, rng = new_engine(config), np.random.default_rng(seed)
    radars = polar_radars(config.model.radars)
    step_s, scores = 0.0, []
    for index, (scan, truth) in enumerate(zip(scans.reference(), scans.truth(), strict=True)):
        reports = scan.detections
        crowded = index in range(CROWDED, CROWDED + CROWDS)
        if crowded and detections:
            reports = tuple(
                _fill(scans.report(index, number), radar, detections, amplitudes, rng)
                for number, radar in enumerate(radars)
            )
        begin = time.process_time()
        (found,) = tracker.step(Scan(scan.stamp_ns, reports)).filtered
        if crowded:
            step_s = max(step_s, time.process_time() - begin)
        if index > CROWDED + CROWDS:
            scores.append(ospa(truth.position, found.position, CUTOFF, ORDER).distance)
        if index == LAST:
            break
    return step_s, float(np.mean(scores))


def of_case(count: int, amplitudes: str, seeds: int) -> dict[str, float]:
    """Return the figures of runs with the crowded scans and of ones without them."""
    every = range(seeds)
    crowded = [_run(count, amplitudes, seed) for seed in every]
    peak = peak_mb()
    without = [_run(0, amplitudes, seed)[1] for seed in every]
    step_s, after = (np.array(column) for column in zip(*crowded, strict=True))
    ratio = float(after.mean() / np.mean(without))
    return {"step_s": float(step_s.max()), "peak_mb": peak, "ratio": ratio}
