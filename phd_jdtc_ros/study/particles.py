# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The package's tracker over a simulated run: one filter, read in several ways and at all lags.

Death term and extraction only decide how the stored sets are read, so variants that differ in
nothing else share one filter, and one backward pass over the window has the sets of all lags.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.configuration.build import TrackerConfig
from phd_jdtc_ros.core.engines import particle_filter
from phd_jdtc_ros.core.evaluation.scan_scores import PointSet
from phd_jdtc_ros.core.smc.extraction import EXTRACTIONS
from phd_jdtc_ros.core.smc.filter import Filtered
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.smc.smoother import DEATH_TERMS, backward_pass

from .runs import SimulatedRun, Tracks


class Reading(NamedTuple):
    """One way to read targets off the filter's sets.

    Parameters
    ----------
    label : str
    death_term : str
        Of `DEATH_TERMS`.
    extraction : str
        Of `EXTRACTIONS`.
    """

    label: str
    death_term: str
    extraction: str


def track(
    run: SimulatedRun, config: TrackerConfig, readings: Sequence[Reading], lags: Sequence[int]
) -> dict[str, Tracks]:
    """Return the tracker's estimates of a run, by the label of the reading and by lag.

    Parameters
    ----------
    run : SimulatedRun
        Its seed is the filter's too.
    config : TrackerConfig
        Lag, seed, death term and extraction in it are not looked at.
    readings : sequence of Reading
    lags : sequence of int
        Scans; 0 is the filter. The last scans have as many later ones as there are.

    Notes
    -----
    An estimate does not depend on which other readings and lags are asked for.
    """
    longest = max(lags)
    forward = particle_filter(replace(config, seed=run.seed))
    readers = [_Reader(reading, run, lags, config) for reading in readings]
    window: list[Filtered] = []
    for index, scan in enumerate(run.scans):
        window = [*window, forward.step(scan, linked=longest > 0)][-(longest + 1) :]
        for reader in readers:
            reader.read_filtered(index, window[-1].updated)
        if longest:
            _read_window(window, index, readers)
    return {reader.reading.label: reader.tracks() for reader in readers}


def _read_window(window: Sequence[Filtered], newest: int, readers: Sequence[_Reader]) -> None:
    """Read the smoothed sets of a window whose newest scan has the index `newest`."""
    stored = [found.stored for found in window]
    links = [found.link for found in window[1:] if found.link is not None]
    for name in dict.fromkeys(reader.reading.death_term for reader in readers):
        for lag, smoothed in enumerate(backward_pass(stored, links, DEATH_TERMS[name])):
            for reader in readers:
                if reader.reading.death_term == name:
                    reader.read_smoothed(newest - lag, lag, smoothed)


class _Reader:
    """Collects one reading's estimates, scan by scan and lag by lag."""

    def __init__(
        self, reading: Reading, run: SimulatedRun, lags: Sequence[int], config: TrackerConfig
    ) -> None:
        self.reading = reading
        self._run, self._modes = run, config.model.modes
        self._threshold = config.existence_threshold
        self._found: dict[int, dict[int, PointSet]] = {lag: {} for lag in lags}
        # One for each lag, so that no lag's draws depend on which others are wanted.
        self._rng = {lag: np.random.default_rng([run.seed, 1, lag]) for lag in lags}

    def read_filtered(self, index: int, updated: ParticleSet) -> None:
        if 0 in self._found:
            self._found[0][index] = self._points(index, 0, updated, 0)

    def read_smoothed(self, index: int, lag: int, smoothed: ParticleSet) -> None:
        run_over = index + lag == len(self._run.scans) - 1
        for wanted in self._found:
            if wanted > 0 and (wanted == lag or (run_over and wanted > lag)):
                self._found[wanted][index] = self._points(index, lag, smoothed, wanted)

    def _points(self, index: int, lag: int, phd: ParticleSet, wanted: int) -> PointSet:
        extract = EXTRACTIONS[self.reading.extraction]
        stamp_ns = self._run.scans[index].stamp_ns
        found = extract(phd, self._modes, stamp_ns, lag, self._threshold, self._rng[wanted])
        return PointSet.of(found)

    def tracks(self) -> Tracks:
        """Return the estimates by lag, in the order of the scans."""
        return {
            lag: [found[index] for index in sorted(found)] for lag, found in self._found.items()
        }
