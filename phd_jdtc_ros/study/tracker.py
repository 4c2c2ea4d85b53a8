"""Simulated runs, and the package's tracker on them: one filter, with all lags."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.engines import gaussian_engine, phd_engine
from phd_jdtc_ros.configuration.parameters.tracker import PHD
from phd_jdtc_ros.core.arrays import IntArray
from phd_jdtc_ros.core.tracks.confirmation import TrackStates
from phd_jdtc_ros.core.types import Estimates, Scan, Truth
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.simulate import simulate_with_sources


class IgnoredTargets(NamedTuple):
    """Criteria of the targets of turning radars that are not scored, with their estimates."""

    below: float = 40.0  # Targets slower than this are not scored, metres per second
    near: float = 1000.0  # Gate of the assignment of estimates to these targets, metres


# The default leaves out taxiing aircraft.
TAXIING = IgnoredTargets()


@dataclass(frozen=True)
class SimulatedRun:
    """One seeded run of a scenario."""

    scenario: Scenario
    seed: int
    truth: tuple[Truth, ...]  # Truth at every scan, or at every revolution if antennas turn
    scans: tuple[Scan, ...]  # Empty if antennas turn
    # The track_id of every detection's target by scan and radar, 0 for clutter. Only references
    # with known association may use it.
    sources: tuple[tuple[IntArray, ...], ...]
    ignored: IgnoredTargets = TAXIING  # Unscored targets if antennas turn


def simulated_run(scenario: Scenario, seed: int) -> SimulatedRun:
    """Return the simulated run of a scenario and a seed."""
    truth, scans, sources = zip(*simulate_with_sources(scenario, seed), strict=True)
    return SimulatedRun(scenario, seed, truth, scans, sources)


# Estimates of every scan or revolution, by lag in scans or revolutions; 0 is the filter.
Tracks: TypeAlias = Mapping[int, list[PointSet]]


class TrackingResult(NamedTuple):
    """A tracker's estimates of a run, with its CPU time."""

    tracks: Tracks
    cpu_ms: float = math.nan  # CPU time per revolution, milliseconds; NaN if not measured


def track(run: SimulatedRun, config: TrackerConfig, lags: Sequence[int]) -> Tracks:
    """Return the tracker's estimates of a run by lag, ordered by scan.

    The run's seed is also the filter's; lag and seed of the configuration are not used. Lags are in
    scans; 0 is the filter. The last scans of the run have fewer later scans. An estimate does not
    depend on the other lags.
    """
    config = replace(config, seed=run.seed)
    return (_track_phd if config.engine in PHD else _track)(run, config, lags)


def _track(run: SimulatedRun, config: TrackerConfig, lags: Sequence[int]) -> Tracks:
    """Return the estimates of the labelled filter by lag, ordered by scan."""
    # The modules load numba and compiled code.
    from phd_jdtc_ros.core.gaussian.entries import Entry
    from phd_jdtc_ros.core.gaussian.extraction import extract
    from phd_jdtc_ros.core.gaussian.mixture import Mixture
    from phd_jdtc_ros.core.gaussian.smoothing.smoother import backward_pass

    forward, states, longest = gaussian_engine(config).forward, TrackStates(config.rule), max(lags)
    estimates: dict[int, dict[int, PointSet]] = {lag: {} for lag in lags}
    window: list[Entry] = []

    def extracted(stored: Mixture, index: int, lag: int, least: float) -> Estimates:
        return extract(stored, forward.dynamics, run.scans[index].stamp_ns, lag, least)

    for index, scan in enumerate(run.scans):
        entry = forward.step(scan, linked=longest > 0)
        window = [*window, entry][-(longest + 1) :]
        found = states.report_filtered(
            extracted(entry.stored, index, 0, config.rule.least),
            entry.stored.label,
            (scan.stamp_ns,),
            scan,
            config.model,
            forward.views,
        )
        states.note(found)
        states.forget_before(run.scans[max(index - longest, 0)].stamp_ns)
        if 0 in estimates:
            estimates[0][index] = PointSet.of(found)
        run_over = index == len(run.scans) - 1
        for lag, smoothed in enumerate(backward_pass(window) if longest else ()):
            for wanted in estimates:
                if wanted > 0 and (wanted == lag or (run_over and wanted > lag)):
                    least = config.rule.least_smoothed
                    found = extracted(smoothed, index - lag, wanted, least)
                    found = states.report_smoothed(found)
                    estimates[wanted][index - lag] = PointSet.of(found)
    return {lag: [of_lag[index] for index in sorted(of_lag)] for lag, of_lag in estimates.items()}


def _track_phd(run: SimulatedRun, config: TrackerConfig, lags: Sequence[int]) -> Tracks:
    """Return the estimates of a PHD filter by lag, ordered by scan."""
    longest = max(lags)
    # With one scan more than the longest lag the window has the scans of all lags after a step.
    engine = phd_engine(replace(config, lag_scans=longest + 1 if longest else 0, lag_s=0.0))
    found: dict[int, dict[int, PointSet]] = {lag: {} for lag in lags}
    for index, scan in enumerate(run.scans):
        (filtered,) = engine.step(scan).filtered
        if 0 in found:
            found[0][index] = PointSet.of(filtered)
        run_over = index == len(run.scans) - 1
        for lag, smoothed in enumerate(engine.smoothed() if longest else ()):
            for wanted in found:
                if wanted > 0 and (wanted == lag or (run_over and wanted > lag)):
                    found[wanted][index - lag] = PointSet.of(smoothed)
    return {lag: [of_lag[index] for index in sorted(of_lag)] for lag, of_lag in found.items()}
