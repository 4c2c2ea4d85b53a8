"""Scans at the limits of floating point: hardly any noise or time, an hour's gap, range zero.

An engine must never publish an invalid covariance, and its state must stay restorable.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, cycle, islice
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import Detections, Estimates, Scan
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.simulation.scenario import paper_scenario
from phd_jdtc_ros.simulation.simulate import simulate

from ..harness import scans
from ..harness.figures import Found, measures, such_as

HOUR_S = 3600.0
USUAL_S = 6.0
# Smallest variance of a position or a velocity.
LEAST_VARIANCE = 1e-12
# Rounding error of the eigenvalues of a correlation matrix.
ROUNDING = 1e-9
LONG_GAPS = {"max_gap_scans": 1e5}
EXACT = {
    f"{radar}.{name}": value
    for radar in ("radar_1", "radar_2")
    for name, value in {"range_std": 1e-3, "azimuth_std_deg": 1e-4}.items()
}
STILL = {"cv.noise_density": 1e-9, "ct.noise_density": 1e-9}

Run = Sequence[Scan]


@dataclass(frozen=True)
class Case:
    """Scans and parameters."""

    scans: Callable[[TrackerConfig], Run]
    values: Mapping[str, Any] = field(default_factory=dict)  # Added to the profile's


def _at(*intervals_s: float) -> Callable[[TrackerConfig], Run]:
    """Return a function that gives the reference scans these intervals, again and again."""

    def run(_: TrackerConfig) -> Run:
        passed = np.cumsum([*islice(cycle(intervals_s), len(scans.reference()))])
        return [
            Scan(scans.START_NS + round(1e9 * since), scan.detections)
            for since, scan in zip(passed, scans.reference(), strict=True)
        ]

    return run


def _simulate(config: TrackerConfig) -> Run:
    """Return scans with the configuration's noise."""
    return [scan for _, scan in simulate(paper_scenario(polar_radars(config.model.radars)), 0)]


def _change(change: Callable[[Detections], Detections]) -> Callable[[TrackerConfig], Run]:
    def run(_: TrackerConfig) -> Run:
        return [
            Scan(scan.stamp_ns, tuple(None if d is None else change(d) for d in scan.detections))
            for scan in scans.reference()
        ]

    return run


def _repeat(found: Detections) -> Detections:
    """Return every detection three times."""
    amplitude = None if found.amplitude is None else np.repeat(found.amplitude, 3)
    return Detections(np.repeat(found.measurement, 3, axis=0), amplitude)


def _at_the_radar(_: Detections) -> Detections:
    """Return detections at the antenna itself, and at the azimuth where it wraps."""
    places = [[0.0, 3.0], [1e-9, 0.0], [1e-3, -3.0], [1e3, np.pi], [1e3, -np.pi]]
    return Detections(np.array(places), np.full(len(places), 30.0))


def _nothing(_: Detections) -> Detections:
    return Detections(np.zeros((0, 2)), np.zeros(0))


CASES: Mapping[str, Case] = {
    "as usual": Case(_at(USUAL_S)),
    "1 ms": Case(_at(1e-3)),
    "1 us": Case(_at(1e-6)),
    "an hour's gap": Case(_at(*[USUAL_S] * 40, HOUR_S), LONG_GAPS),
    "1 ms and an hour": Case(_at(*[USUAL_S] * 5, 1e-3, HOUR_S), {**LONG_GAPS, "spawn.rate": 0.0}),
    "hardly any noise": Case(_simulate, EXACT),
    "hardly any noise of radars and motions": Case(_simulate, {**EXACT, **STILL}),
    "less noise assumed than there is": Case(_at(USUAL_S), EXACT),
    "every detection three times": Case(_change(_repeat)),
    "at the radar": Case(_change(_at_the_radar)),
    "no detections": Case(_change(_nothing)),
}


@measures(
    "numbers at their edges",
    "0 errors, 0 NaN, 0 estimates without a covariance, every snapshot restorable",
)
def measure(cases: Mapping[str, Case] = CASES) -> Found:
    """Track every case."""
    wrong: dict[str, str] = {}
    seconds = {}
    for name, case in cases.items():
        begin = time.process_time()
        fault = outcome(case)
        seconds[name] = time.process_time() - begin
        if fault:
            wrong[name] = fault
    text = f"{len(cases)} kinds: {len(wrong)} wrong{such_as(wrong)}"
    return text, not wrong, {"wrong": wrong, "seconds": seconds}


def outcome(case: Case) -> str:
    """Return the fault in an engine's estimates of a case; empty without one."""
    config = from_arguments.config_of({**from_arguments.load(scans.PROFILE), **case.values})
    tracker, restored = new_engine(config), new_engine(config)
    try:
        for index, scan in enumerate(case.scans(config)):
            step = tracker.step(scan)
            for estimates in (*step.filtered, *step.smoothed):
                fault = fault_of(estimates, LEAST_VARIANCE)
                if fault:
                    return f"scan {index}, lag {estimates.lag}: {fault}"
            if not np.isfinite([*step.class_mass, *step.figures.values()]).all():
                return f"scan {index}: figures that are not finite"
        restored.restore(tracker.snapshot())
        rest = chain(tracker.flush(), restored.flush())
        faults = (fault_of(estimates, LEAST_VARIANCE) for estimates in rest)
        return next(filter(None, faults), "")
    except Exception as error:  # Any of them would end the node
        return f"{type(error).__name__}: {error}"[:200]


def fault_of(found: Estimates, least_variance: float) -> str:
    """Return the fault of estimates; empty without one."""
    for name in ("state", "covariance", "weight", "class_probability"):
        if not np.isfinite(getattr(found, name)).all():
            return f"{name} is not finite"
    return next(_faults_of_covariances(found.covariance, least_variance), "")


def _faults_of_covariances(covariance: FloatArray, least_variance: float) -> Iterator[str]:
    if not len(covariance):
        return
    apart = np.abs(covariance - covariance.swapaxes(1, 2))
    if (apart > ROUNDING * np.abs(covariance).max(axis=(1, 2), keepdims=True)).any():
        yield "a covariance is not symmetric"
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    # The turn rate of a target without a turning motion has no variance.
    if (variance[:, :4] < least_variance).any() or (variance < 0.0).any():
        yield "a variance is not positive"
    std = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    correlation = covariance / std[:, :, None] / std[:, None, :]
    least = float(np.linalg.eigvalsh(correlation).min())
    if least < -ROUNDING:
        yield f"a covariance has a negative eigenvalue, {least:.1e} of a correlation"
