"""The package's tracker on a simulated run: one filter, with several extractions and all lags.

The filter does not depend on death term and extraction. Variants that differ only in these share
one filter, and one backward pass over the window gives the smoothed sets of all lags, for every
engine. The modules of an engine are imported when its first run begins, because they load numba and
compiled code.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.engines import gaussian_engine, particle_filter
from phd_jdtc_ros.core.tracks.confirmation import TrackStates
from phd_jdtc_ros.core.tracks.reporting_rule import ReportingRule
from phd_jdtc_ros.core.types import Estimates
from phd_jdtc_ros.core.window.entries import Entry
from phd_jdtc_ros.core.window.forward_filter import ForwardFilter
from phd_jdtc_ros.evaluation.comparison import PointSet

from .runs import ExtractionVariant, SimulatedRun, Tracks

# The entries of the latest scans, oldest first; the type of their sets depends on the engine.
Window: TypeAlias = "Sequence[Entry[Any, Any]]"


class Extraction(NamedTuple):
    """How estimates are extracted from a set."""

    variant: ExtractionVariant
    stamp_ns: int
    lag: int
    threshold: float
    rng: np.random.Generator


class _Parts(NamedTuple):
    """The parts of an engine."""

    forward: ForwardFilter[Any, Any]
    # Returns the smoothed sets, newest first, given window and death term.
    backward: Callable[[Window, str], Iterable[Any]]
    extract: Callable[[Any, Extraction], Estimates]
    rule: ReportingRule


def _of_particles(config: TrackerConfig) -> _Parts:
    from phd_jdtc_ros.core.smc.extraction import EXTRACTIONS, estimates
    from phd_jdtc_ros.core.smc.smoother import DEATH_TERMS, backward_pass

    modes = config.model.modes

    def backward(window: Window, death_term: str) -> Iterable[Any]:
        return backward_pass(window, DEATH_TERMS[death_term])

    def extract(stored: Any, how: Extraction) -> Estimates:
        groups = EXTRACTIONS[how.variant.extraction](stored, modes, how.threshold, how.rng)
        return estimates(stored, modes, how.stamp_ns, how.lag, groups)

    return _Parts(particle_filter(config), backward, extract, config.rule)


def _of_gaussians(config: TrackerConfig) -> _Parts:
    from phd_jdtc_ros.core.gaussian.extraction import extract as extract_gaussians
    from phd_jdtc_ros.core.gaussian.smoothing import smoother

    forward = gaussian_engine(config).forward

    def backward(window: Window, _: str) -> Iterable[Any]:
        return smoother.backward_pass(window)

    def extract(stored: Any, how: Extraction) -> Estimates:
        return extract_gaussians(stored, forward.dynamics, how.stamp_ns, how.lag, how.threshold)

    return _Parts(forward, backward, extract, config.rule)


# Functions that return an engine's parts, by its name, see `configuration.engines`.
PARTS = {"particles": _of_particles, "gaussian": _of_gaussians}


def track(
    run: SimulatedRun,
    config: TrackerConfig,
    variants: Sequence[ExtractionVariant],
    lags: Sequence[int],
) -> dict[str, Tracks]:
    """Return the tracker's estimates of a run, by label of the variant and by lag.

    The run's seed is also the filter's; lag, seed, death term and extraction of the configuration
    are not used. Lags are in scans; 0 is the filter. The last scans of the run have fewer later
    scans. An estimate does not depend on the other variants and lags.
    """
    longest = max(lags)
    parts = PARTS[config.engine](replace(config, seed=run.seed))
    extractors = [_Extractor(variant, run, lags, parts) for variant in variants]
    window: list[Entry[Any, Any]] = []
    for index, scan in enumerate(run.scans):
        step = parts.forward.step(scan, linked=longest > 0)
        window = [*window, step.entry][-(longest + 1) :]
        for extractor in extractors:
            extractor.extract_filtered(index, step.updated)
        if longest:
            _smooth_window(window, index, extractors, parts)
    return {extractor.variant.label: extractor.tracks() for extractor in extractors}


def _smooth_window(
    window: Window, newest: int, extractors: Sequence[_Extractor], parts: _Parts
) -> None:
    """Smooth a window whose newest scan has the index `newest`, and extract the estimates."""
    for name in dict.fromkeys(extractor.variant.death_term for extractor in extractors):
        for lag, smoothed in enumerate(parts.backward(window, name)):
            for extractor in extractors:
                if extractor.variant.death_term == name:
                    extractor.extract_smoothed(newest - lag, lag, smoothed)


class _Extractor:
    """Collects the estimates of one variant of extraction, by lag and scan."""

    def __init__(
        self, variant: ExtractionVariant, run: SimulatedRun, lags: Sequence[int], parts: _Parts
    ) -> None:
        self.variant = variant
        self._run, self._parts, self._states = run, parts, TrackStates(parts.rule)
        self._estimates: dict[int, dict[int, PointSet]] = {lag: {} for lag in lags}
        # One generator per lag, so that the draws of a lag do not depend on the other lags.
        self._rng = {lag: np.random.default_rng([run.seed, 1, lag]) for lag in {0, *lags}}

    def extract_filtered(self, index: int, updated: Any) -> None:
        """Extract the filtered estimates, on which the smoothed ones depend too."""
        scan, longest = self._run.scans[index], max(self._estimates)
        found = self._extract(updated, index, 0, self._parts.rule.least, self._rng[0])
        found = self._states.report_filtered(
            found, updated.label, (scan.stamp_ns,), scan, self._parts.forward.learned_model
        )
        self._states.note(found)
        self._states.forget_before(self._run.scans[max(index - longest, 0)].stamp_ns)
        if 0 in self._estimates:
            self._estimates[0][index] = PointSet.of(found)

    def extract_smoothed(self, index: int, lag: int, smoothed: Any) -> None:
        run_over = index + lag == len(self._run.scans) - 1
        for wanted in self._estimates:
            if wanted > 0 and (wanted == lag or (run_over and wanted > lag)):
                least, rng = self._parts.rule.least_smoothed, self._rng[wanted]
                found = self._extract(smoothed, index, lag, least, rng)
                self._estimates[wanted][index] = PointSet.of(self._states.report_smoothed(found))

    def _extract(
        self, stored: Any, index: int, lag: int, threshold: float, rng: np.random.Generator
    ) -> Estimates:
        stamp_ns = self._run.scans[index].stamp_ns
        return self._parts.extract(stored, Extraction(self.variant, stamp_ns, lag, threshold, rng))

    def tracks(self) -> Tracks:
        """Return the estimates by lag, ordered by scan."""
        return {
            lag: [by_scan[index] for index in sorted(by_scan)]
            for lag, by_scan in self._estimates.items()
        }
