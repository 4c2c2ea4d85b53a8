"""An engine with the CPU time of every part of a step."""

from __future__ import annotations

import time

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.engines import gaussian_engine
from phd_jdtc_ros.core.engine import Step
from phd_jdtc_ros.core.gaussian.entries import Entry, UnsweptRows
from phd_jdtc_ros.core.gaussian.mixture import Mixture
from phd_jdtc_ros.core.types import Scan
from phd_jdtc_ros.simulation.scenario import Scenario

from .. import scenes

GAUSSIAN = "gaussian"
# With mixed motion modes, as in the profiles for many targets.
FAST = "gaussian, accuracy fast"
# Accuracy of the measured forms.
FORMS = {GAUSSIAN: "normal", FAST: "fast"}
PARTS = ("predict", "update", "reduce", "backward", "extraction")
# Number of scans after which targets started at the truth are distributed as in a run.
SETTLING = 6


class TimedEngine:
    """An engine that measures the CPU time of each part of a step.

    `start` is the stored set an interval before the first scan; None for a new start.
    """

    def __init__(self, config: TrackerConfig, start: Mixture | None = None) -> None:
        self._engine = gaussian_engine(config)
        self._engine.forward.on_stage_end = self._note
        self._interval_ns = round(config.model.modes.interval_s * 1e9)
        self._start = start
        self._latest_s = 0.0
        self.parts_ms = dict.fromkeys(PARTS, 0.0)

    def step(self, scan: Scan) -> Step:
        """Take in a scan."""
        if self._start is not None:
            stamp_ns, forward = scan.stamp_ns - self._interval_ns, self._engine.forward
            forward.stamp_ns = stamp_ns
            forward.unswept = [UnsweptRows(Entry(stamp_ns, self._start))]
            self._start = None
        self.parts_ms = dict.fromkeys(PARTS, 0.0)
        self._latest_s = time.process_time()
        return self._engine.step(scan)

    @property
    def hypotheses(self) -> int:
        """Number of hypotheses of the last stored set."""
        return len(self._engine.forward.unswept[-1].entry.stored)

    def _note(self, part: str) -> None:
        now = time.process_time()
        self.parts_ms[part] += 1e3 * (now - self._latest_s)
        self._latest_s = now


def tracking(config: TrackerConfig, scene: Scenario) -> TimedEngine:
    """Return an engine that tracks all targets of a crowd when its first scan comes."""
    return TimedEngine(config, scenes.mixture(scene, config))
