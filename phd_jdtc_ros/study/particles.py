# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The package's tracker on a simulated run: one filter, with several extractions and all lags.

The filter does not depend on death term and extraction. Variants that differ only in these share
one filter, and one backward pass over the window gives the smoothed sets of all lags.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.configuration.build import TrackerConfig
from phd_jdtc_ros.core.engines import particle_filter
from phd_jdtc_ros.core.evaluation.scan_scores import PointSet
from phd_jdtc_ros.core.smc.backward_kernel import ParticleEntry
from phd_jdtc_ros.core.smc.extraction import EXTRACTIONS
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.smc.smoother import DEATH_TERMS, backward_pass

from .runs import SimulatedRun, Tracks


class Reading(NamedTuple):
    """A death term and an extraction for the filter's sets.

    Parameters
    ----------
    label : str
    death_term : str
        One of `DEATH_TERMS`.
    extraction : str
        One of `EXTRACTIONS`.
    """

    label: str
    death_term: str
    extraction: str


def track(
    run: SimulatedRun, config: TrackerConfig, readings: Sequence[Reading], lags: Sequence[int]
) -> dict[str, Tracks]:
    """Return the tracker's estimates of a run, by label of the reading and by lag.

    Parameters
    ----------
    run : SimulatedRun
        Its seed is also that of the filter.
    config : TrackerConfig
        Its lag, seed, death term and extraction are not used.
    readings : sequence of Reading
    lags : sequence of int
        Scans; 0 is the filter. The last scans of the run are smoothed with the fewer scans that
        follow them.

    Notes
    -----
    An estimate does not depend on the other readings and lags.
    """
    longest = max(lags)
    forward = particle_filter(replace(config, seed=run.seed))
    readers = [_Reader(reading, run, lags, config) for reading in readings]
    window: list[ParticleEntry] = []
    for index, scan in enumerate(run.scans):
        step = forward.step(scan, linked=longest > 0)
        window = [*window, step.entry][-(longest + 1) :]
        for reader in readers:
            reader.read_filtered(index, step.updated)
        if longest:
            _read_window(window, index, readers)
    return {reader.reading.label: reader.tracks() for reader in readers}


def _read_window(window: Sequence[ParticleEntry], newest: int, readers: Sequence[_Reader]) -> None:
    """Smooth a window whose newest scan has the index `newest`, and extract the estimates."""
    for name in dict.fromkeys(reader.reading.death_term for reader in readers):
        for lag, smoothed in enumerate(backward_pass(window, DEATH_TERMS[name])):
            for reader in readers:
                if reader.reading.death_term == name:
                    reader.read_smoothed(newest - lag, lag, smoothed)


class _Reader:
    """Collects the estimates of one reading, by lag and scan."""

    def __init__(
        self, reading: Reading, run: SimulatedRun, lags: Sequence[int], config: TrackerConfig
    ) -> None:
        self.reading = reading
        self._run, self._modes = run, config.model.modes
        self._threshold = config.existence_threshold
        self._estimates: dict[int, dict[int, PointSet]] = {lag: {} for lag in lags}
        # One generator per lag, so that the draws of a lag do not depend on the other lags.
        self._rng = {lag: np.random.default_rng([run.seed, 1, lag]) for lag in lags}

    def read_filtered(self, index: int, updated: ParticleSet) -> None:
        if 0 in self._estimates:
            self._estimates[0][index] = self._points(index, 0, updated, 0)

    def read_smoothed(self, index: int, lag: int, smoothed: ParticleSet) -> None:
        run_over = index + lag == len(self._run.scans) - 1
        for wanted in self._estimates:
            if wanted > 0 and (wanted == lag or (run_over and wanted > lag)):
                self._estimates[wanted][index] = self._points(index, lag, smoothed, wanted)

    def _points(self, index: int, lag: int, phd: ParticleSet, wanted: int) -> PointSet:
        extract = EXTRACTIONS[self.reading.extraction]
        stamp_ns = self._run.scans[index].stamp_ns
        estimates = extract(phd, self._modes, stamp_ns, lag, self._threshold, self._rng[wanted])
        return PointSet.of(estimates)

    def tracks(self) -> Tracks:
        """Return the estimates by lag, in the order of the scans."""
        return {
            lag: [by_scan[index] for index in sorted(by_scan)]
            for lag, by_scan in self._estimates.items()
        }
