# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The engine's step divided into its parts, so that these can be timed and the sets inspected.

`phd_jdtc_ros.core.smc.engine` calls the same functions in the same order with the same draws; a
test checks that both give equal estimates.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from phd_jdtc_ros.core.configuration.build import TrackerConfig
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.simulation.simulate import simulate
from phd_jdtc_ros.core.smc import backward_kernel
from phd_jdtc_ros.core.smc.backward_kernel import Transition
from phd_jdtc_ros.core.smc.engine import EXTRACTION_STREAM
from phd_jdtc_ros.core.smc.extraction import EXTRACTIONS
from phd_jdtc_ros.core.smc.filter import FILTER_STREAM
from phd_jdtc_ros.core.smc.particle_set import ParticlePHD
from phd_jdtc_ros.core.smc.prediction import predict
from phd_jdtc_ros.core.smc.resampling import resample
from phd_jdtc_ros.core.smc.smoother import DEATH_TERMS, backward_pass
from phd_jdtc_ros.core.smc.update import update_scan
from phd_jdtc_ros.core.types import Estimates, Scan

from . import scenes

PARTS = ("predict", "update", "resample", "transition", "backward", "extraction")
# Number of scans after which particles started at the truth are distributed as in a run.
SETTLING = 6


@dataclass
class Recursion:
    """The filter and its fixed-lag smoother, step by step, with the CPU time of every part.

    Parameters
    ----------
    config : TrackerConfig
        Its lag is in scans.
    latest : ParticlePHD
        The stored set one interval before the first scan; empty for a new start.
    """

    config: TrackerConfig
    latest: ParticlePHD
    stored: list[ParticlePHD] = field(default_factory=list)
    links: list[Transition] = field(default_factory=list)
    parts_ms: dict[str, float] = field(default_factory=dict)
    _stamp_ns: int | None = None
    _index: int = 0

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng([self.config.seed, FILTER_STREAM])
        self._extraction_rng = np.random.default_rng([self.config.seed, EXTRACTION_STREAM])
        self._extract = EXTRACTIONS[str(self.config.values["extraction"])]
        self._death_term = DEATH_TERMS[str(self.config.values["death_term"])]

    def step(self, scan: Scan) -> tuple[Estimates, Estimates | None]:
        """Process a scan; return the filtered estimates and, after the lag, the smoothed ones."""
        model, rng, lag = self.config.model, self._rng, self.config.lag.scans
        dt = model.modes.interval_s
        if self._stamp_ns is not None:
            dt = (scan.stamp_ns - self._stamp_ns) * 1e-9
        self.parts_ms = dict.fromkeys(PARTS, 0.0)
        with self._timed("predict"):
            predicted = predict(self.latest, model, self.config.budget, dt, self._index, rng)
        with self._timed("update"):
            updated, found = update_scan(predicted, scan, model, dt, self._index, rng)
        with self._timed("resample"):
            stored = resample(updated, model.modes, self.config.budget, rng)
        if self.stored:
            with self._timed("transition"):
                self.links.append(backward_kernel.build(self.latest, stored, model, dt, found))
        with self._timed("extraction"):
            filtered = self._targets(updated, scan.stamp_ns, 0)
        self.stored.append(stored)
        self.latest, self._stamp_ns, self._index = stored, scan.stamp_ns, self._index + 1
        if len(self.stored) <= lag:
            return filtered, None
        with self._timed("backward"):
            *_, smoothed = backward_pass(self.stored, self.links, self._death_term)
        del self.stored[0], self.links[0]
        # The smoothed stamp is the time of the state; the scans here are at equal intervals.
        stamp_ns = scan.stamp_ns - round(lag * dt * 1e9)
        with self._timed("extraction"):
            late = self._targets(smoothed, stamp_ns, lag)
        return filtered, late

    def _targets(self, phd: ParticlePHD, stamp_ns: int, lag: int) -> Estimates:
        modes, threshold = self.config.model.modes, self.config.existence_threshold
        return self._extract(phd, modes, stamp_ns, lag, threshold, self._extraction_rng)

    @contextmanager
    def _timed(self, part: str) -> Iterator[None]:
        begin = time.process_time()
        yield
        self.parts_ms[part] += 1e3 * (time.process_time() - begin)


@dataclass(frozen=True)
class Window:
    """Consecutive stored sets of a running filter, one more than the lag.

    Parameters
    ----------
    stored : tuple of ParticlePHD
        The oldest first.
    model : TrackerModel
    dt : float
        Between consecutive sets, seconds.
    """

    stored: tuple[ParticlePHD, ...]
    model: TrackerModel
    dt: float

    @property
    def particles(self) -> int:
        """Copies in the newest set."""
        return int(self.stored[-1].multiplicity.sum())

    @property
    def rows(self) -> int:
        """Unique particles in the newest set."""
        return len(self.stored[-1])

    def links(self) -> list[Transition]:
        """Return the cached transitions between the sets."""
        return [
            backward_kernel.build(earlier, later, self.model, self.dt)
            for earlier, later in itertools.pairwise(self.stored)
        ]


def window(
    targets: int, per_target: int, lag: int, seed: int, corrector: str = "bernoulli"
) -> Window:
    """Return the sets of a filter that has tracked `targets` targets for a while."""
    config = scenes.configuration(targets, per_target, corrector)
    scene = scenes.crowd(targets, SETTLING + lag + 1, config, seed)
    start = scenes.clouds(scene, config, np.random.default_rng(seed))
    # Only the filter, because the sets do not depend on the smoother.
    rng = np.random.default_rng([seed, FILTER_STREAM])
    stored = [start]
    for index, (_, scan) in enumerate(simulate(scene, seed)):
        phd = predict(stored[-1], config.model, config.budget, scene.interval_s, index, rng)
        phd, _ = update_scan(phd, scan, config.model, scene.interval_s, index, rng)
        stored = [*stored, resample(phd, config.model.modes, config.budget, rng)]
        stored = stored[-(lag + 1) :]
    return Window(tuple(stored), config.model, scene.interval_s)
