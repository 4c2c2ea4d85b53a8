# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What radars with a higher detection threshold would have reported."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from phd_jdtc_ros.core.types import Detections, Scan

from ..runs import SimulatedRun


def raised_threshold(run: SimulatedRun, threshold: float) -> SimulatedRun:
    """Return the run as radars with a higher detection threshold would have reported it.

    Parameters
    ----------
    run : SimulatedRun
    threshold : float
        On the amplitude, at least that of every radar.

    Raises
    ------
    ValueError
        For a lower one.
    """
    lowest = max(radar.threshold for radar in run.scenario.radars)
    if threshold < lowest:
        raise ValueError(f"threshold: {threshold} given, must be at least {lowest}")
    # Clutter envelopes are Rayleigh: memoryless in their square.
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
        heard = [np.asarray(d.amplitude) > threshold for d in scan.detections]
        reports = [
            Detections(d.measurement[mask], d.amplitude[mask])
            for d, mask in zip(scan.detections, heard, strict=True)
        ]
        scans.append(Scan(scan.stamp_ns, tuple(reports)))
        sources.append(tuple(s[mask] for s, mask in zip(source, heard, strict=True)))
    return replace(
        run,
        scenario=replace(run.scenario, radars=radars),
        scans=tuple(scans),
        sources=tuple(sources),
    )
