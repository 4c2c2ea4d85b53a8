"""Raises the radars' detection threshold in a simulated run."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from phd_jdtc_ros.core.types import Detections, Scan

from ..runs import SimulatedRun


def raised_threshold(run: SimulatedRun, threshold: float) -> SimulatedRun:
    """Return the same run as reported by radars with a higher detection threshold.

    Parameters
    ----------
    run : SimulatedRun
    threshold : float
        Threshold of the amplitude; at least the threshold of every radar.

    Raises
    ------
    ValueError
        If it is lower.
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
        above = [np.asarray(d.amplitude) > threshold for d in scan.detections]
        reports = [
            Detections(d.measurement[mask], d.amplitude[mask])
            for d, mask in zip(scan.detections, above, strict=True)
        ]
        scans.append(Scan(scan.stamp_ns, tuple(reports)))
        sources.append(tuple(s[mask] for s, mask in zip(source, above, strict=True)))
    return replace(
        run,
        scenario=replace(run.scenario, radars=radars),
        scans=tuple(scans),
        sources=tuple(sources),
    )
