"""An engine with the CPU time of every part of a step, and a window of particle sets."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.engines import ENGINES, particle_filter
from phd_jdtc_ros.core.engine import Step
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.models.tracker_model import TrackerModel
from phd_jdtc_ros.core.smc.correction import Corrector
from phd_jdtc_ros.core.smc.kernel import backward_kernel
from phd_jdtc_ros.core.smc.kernel.backward_kernel import ParticleEntry, Transition
from phd_jdtc_ros.core.smc.particle_set import ParticleSet
from phd_jdtc_ros.core.types import Scan
from phd_jdtc_ros.core.window.entries import Entry, Source
from phd_jdtc_ros.core.window.fixed_lag import FixedLagEngine
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.simulate import simulate

from .. import scenes

PARTICLES, GAUSSIAN = "particles", "gaussian"
# Gaussians with mixed motion modes, as in the profiles for many targets.
FAST = "gaussian, accuracy fast"
PARTS = {
    PARTICLES: ("predict", "update", "resample", "transition", "backward", "extraction"),
    GAUSSIAN: ("predict", "update", "reduce", "backward", "extraction"),
}
# Engine and accuracy of the measured forms.
FORMS = {PARTICLES: (PARTICLES, "normal"), GAUSSIAN: (GAUSSIAN, "normal"), FAST: (GAUSSIAN, "fast")}
# Number of scans after which particles started at the truth are distributed as in a run.
SETTLING = 6


class TimedEngine:
    """An engine that measures the CPU time of each part of a step.

    `start` is the stored set an interval before the first scan; None for a new start.
    """

    def __init__(self, config: TrackerConfig, start: ParticleSet | Mixture | None = None) -> None:
        engine = ENGINES[config.engine](config)
        if not isinstance(engine, FixedLagEngine):
            raise TypeError(f"engine: {config.engine} does not report the ends of its parts")
        self._engine: FixedLagEngine[Any, Any] = engine
        self._engine.forward.on_stage_end = self._note
        self._interval_ns = round(config.model.modes.interval_s * 1e9)
        self._start = start
        self._latest_s = 0.0
        self._parts = PARTS[config.engine]
        self.parts_ms = dict.fromkeys(self._parts, 0.0)

    def step(self, scan: Scan) -> Step:
        """Take in a scan."""
        if self._start is not None:
            self._engine.forward.start_from(scan.stamp_ns - self._interval_ns, self._start)
            self._start = None
        self.parts_ms = dict.fromkeys(self._parts, 0.0)
        self._latest_s = time.process_time()
        return self._engine.step(scan)

    @property
    def stored(self) -> Any:
        """The last stored set."""
        return self._engine.forward.unswept[-1].entry.stored

    def _note(self, part: str) -> None:
        now = time.process_time()
        self.parts_ms[part] += 1e3 * (now - self._latest_s)
        self._latest_s = now


def tracking(config: TrackerConfig, scene: Scenario, seed: int) -> TimedEngine:
    """Return an engine that tracks all targets of a crowd when its first scan comes."""
    if config.engine == GAUSSIAN:
        return TimedEngine(config, scenes.mixture(scene, config))
    return TimedEngine(config, scenes.clouds(scene, config, np.random.default_rng(seed)))


@dataclass(frozen=True)
class Window:
    """Consecutive stored sets of a running filter, one more than the lag."""

    stored: tuple[ParticleSet, ...]  # The oldest first
    model: TrackerModel
    corrector: Corrector
    dt: float  # Between consecutive sets, seconds

    @property
    def assumed(self) -> tuple[TrackerModel, Corrector, float]:
        """The model, corrector and interval of the transitions between two sets."""
        return self.model, self.corrector, self.dt

    @property
    def last(self) -> tuple[ParticleSet, ParticleSet]:
        """The newest two sets."""
        earlier, later = self.stored[-2:]
        return earlier, later

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
            backward_kernel.build(earlier, later, *self.assumed)
            for earlier, later in itertools.pairwise(self.stored)
        ]


def chain(stored: Sequence[ParticleSet], links: Sequence[Transition]) -> list[ParticleEntry]:
    """Return the entries of consecutive sets, each the only source of the next."""
    entries: list[ParticleEntry] = [Entry(0, stored[0])]
    for index, (earlier, later, link) in enumerate(
        zip(stored[:-1], stored[1:], links, strict=True)
    ):
        entries.append(Entry(index + 1, later, (Source(index, None, len(earlier)),), link))
    return entries


def window(targets: int, per_target: int, lag: int, seed: int, engine: str = "particles") -> Window:
    """Return the sets of a filter that has tracked `targets` targets for a while."""
    config = replace(scenes.configuration(targets, per_target, engine), seed=seed)
    # The first sets have more particles of each target, because all are newborn.
    scene = scenes.crowd(targets, SETTLING + 2 * lag + 1, config, seed)
    # The filter alone: the sets do not depend on the smoother.
    forward = particle_filter(config)
    start = scenes.clouds(scene, config, np.random.default_rng(seed))
    forward.start_from(scene.start_ns - round(scene.interval_s * 1e9), start)
    stored = [forward.step(scan, linked=False).entry.stored for _, scan in simulate(scene, seed)]
    return Window(tuple(stored[-(lag + 1) :]), config.model, forward.corrector, scene.interval_s)
