"""Raises the radars' detection threshold in a simulated run."""

from __future__ import annotations

import math
from dataclasses import replace

from phd_jdtc_ros.core.types import Detections, Scan
from phd_jdtc_ros.study.tracker import SimulatedRun


def raised_threshold(run: SimulatedRun, threshold: float) -> SimulatedRun:
    """Return the same run as reported by radars with a higher detection threshold.

    Raise `ValueError` if it is below the threshold of a radar, or if a radar reports no amplitudes.
    """
    lowest = max(radar.threshold for radar in run.scenario.radars)
    if threshold < lowest:
        raise ValueError(f"threshold: {threshold} given, must be at least {lowest}")
    # Squares of clutter envelopes are exponential, which determines the share above a threshold.
    radars = tuple(
        replace(
            radar,
            threshold=threshold,
            clutter_rate=radar.clutter_rate * math.exp(0.5 * (radar.threshold**2 - threshold**2)),
        )
        for radar in run.scenario.radars
    )
    scans, sources = [], []
    for scan, source in zip(run.scans, run.sources, strict=True):
        reports, kept = [], []
        for found, origin in zip(scan.detections, source, strict=True):
            if found is None or found.amplitude is None:
                raise ValueError(f"scan of {scan.stamp_ns} ns: a radar reports no amplitudes")
            above = found.amplitude > threshold
            reports.append(Detections(found.measurement[above], found.amplitude[above]))
            kept.append(origin[above])
        scans.append(Scan(scan.stamp_ns, tuple(reports)))
        sources.append(tuple(kept))
    return replace(
        run,
        scenario=replace(run.scenario, radars=radars),
        scans=tuple(scans),
        sources=tuple(sources),
    )
