"""Simulated runs, and the package's tracker on them: one filter, with all lags.

Trackers of turning radars are scored at the end of each revolution of the first one, with their
estimates predicted to this time. Slow targets, such as taxiing aircraft and ships at anchor, are
not scored there.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from phd_jdtc_ros.columns.selection import Report as Received
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.engines import gaussian_engine, phd_engine
from phd_jdtc_ros.configuration.parameters.tracker import PHD
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.intake.posed_reports import RadarPose
from phd_jdtc_ros.core.pipeline import Event, RunEnded
from phd_jdtc_ros.core.tracks.confirmation import TrackStates
from phd_jdtc_ros.core.types import COASTING, FILTERED, SMOOTHED, SOURCES, Estimates, Scan, Truth
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.feed import Feed
from phd_jdtc_ros.simulation.scenario import Scenario, truth_after
from phd_jdtc_ros.simulation.simulate import simulate_with_sources
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport, simulate_reports
from phd_jdtc_ros.tally import Tally


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
    """Return truth and scans of a scenario with the source of each detection."""
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
    from phd_jdtc_ros.core.gaussian.smoothing.smoother import backward_pass

    forward, states, longest = gaussian_engine(config).forward, TrackStates(config.rule), max(lags)
    estimates: dict[int, dict[int, PointSet]] = {lag: {} for lag in lags}
    window: list[Entry] = []

    for index, scan in enumerate(run.scans):
        entry = forward.step(scan, linked=longest > 0)
        window = [*window, entry][-(longest + 1) :]
        found = forward.report(states, scan)
        states.note(found)
        states.forget_before(run.scans[max(index - longest, 0)].stamp_ns)
        if 0 in estimates:
            estimates[0][index] = PointSet.of(found)
        run_over = index == len(run.scans) - 1
        for lag, smoothed in enumerate(backward_pass(window) if longest else ()):
            for wanted in estimates:
                if wanted > 0 and (wanted == lag or (run_over and wanted > lag)):
                    stamp_ns, least = run.scans[index - lag].stamp_ns, config.rule.least_smoothed
                    found = extract(smoothed, forward.dynamics, stamp_ns, wanted, least)
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


# Largest age of estimates that are predicted to a stamp, in revolutions.
OLDEST_REVOLUTIONS = 1.5


def revolution_ends(scenario: Scenario) -> list[float]:
    """Return the ends of the first turning radar's revolutions, seconds after scan 0."""
    index = next(k for k, radar in enumerate(scenario.radars) if radar.rotation_s > 0.0)
    rotation_s, antenna = scenario.radars[index].rotation_s, scenario.antennas[index]
    last = antenna.revolutions_at(np.array(scenario.duration_s), rotation_s)
    revolutions = np.arange(int(np.ceil(antenna.begin)) + 1, int(last + 1e-9) + 1, dtype=float)
    ends: list[float] = antenna.times_at(revolutions, rotation_s).tolist()
    return ends


def turning_run(scenario: Scenario, seed: int, ignored: IgnoredTargets = TAXIING) -> SimulatedRun:
    """Return a run without scans whose truth is at the end of each revolution."""
    truths = (truth_after(scenario, end) for end in revolution_ends(scenario))
    truth = tuple(_without_slow(known, ignored) for known in truths)
    return SimulatedRun(scenario, seed, truth, (), (), ignored)


def _without_slow(truth: Truth, ignored: IgnoredTargets) -> Truth:
    rows = np.flatnonzero(np.hypot(*truth.velocity.T) >= ignored.below)
    return replace(
        truth,
        state=truth.state[rows],
        track_id=truth.track_id[rows],
        class_id=truth.class_id[rows],
        height=None if truth.height is None else truth.height[rows],
    )


def without_ignored(run: SimulatedRun, found: Sequence[PointSet]) -> list[PointSet]:
    """Return a tracker's estimates at the stamps of the truth without estimates of ignored targets.

    Targets and estimates are paired by position; false estimates stay.
    """
    rest = []
    for scored, points in zip(run.truth, found, strict=True):
        everything = truth_after(run.scenario, (scored.stamp_ns - run.scenario.start_ns) * 1e-9)
        target, estimate = assign(everything.position, points.position, run.ignored.near)
        slow = ~np.isin(everything.track_id[target], scored.track_id)
        rest.append(points.only(np.delete(np.arange(len(points)), estimate[slow])))
    return rest


def track_turning(
    run: SimulatedRun, parameters: Mapping[str, Any], lags: Sequence[int]
) -> TrackingResult:
    """Return this package's estimates of a run, by lag in revolutions.

    The run is that of `turning_run`; its seed is also the filter's. The parameters include the
    reporting of the radars, which does not change the plots. Lag 0 is the filter, taken from the
    run of the longest lag. The tracker runs once for each lag above 0; the CPU time is the last
    run's.
    """
    tracks: dict[int, list[PointSet]] = {}
    scenario, rotation_s, spent_s = run.scenario, _rotation_s(run.scenario), 0.0
    for lag in sorted(lag for lag in {*lags, 0} if lag or not any(lags)):
        own = {"seed": run.seed, "lag": 0, "lag_s": lag * rotation_s}
        config = resolve({**parameters, **own})
        reports = simulate_reports(scenario, config.radars, run.seed)
        found, spent_s = estimates_of(scenario, config, reports)
        for source, of_lag in ((FILTERED, 0), (SMOOTHED, lag)):
            if of_lag in lags:
                stamps = [truth.stamp_ns for truth in run.truth]
                points = at_stamps(found[source], stamps, OLDEST_REVOLUTIONS * rotation_s)
                tracks[of_lag] = without_ignored(run, points)
    return TrackingResult(tracks, 1e3 * spent_s / max(len(run.truth), 1))


def _rotation_s(scenario: Scenario) -> float:
    return next(radar.rotation_s for radar in scenario.radars if radar.rotation_s > 0.0)


def estimates_of(
    scenario: Scenario, config: TrackerConfig, reports: Sequence[SimulatedReport]
) -> tuple[dict[str, list[Estimates]], float]:
    """Return the estimates of a run by source from its reports, and the CPU time in seconds."""
    found: dict[str, list[Estimates]] = {source: [] for source in SOURCES}
    begin = time.process_time()
    for event in _events(config, scenario, reports):
        if isinstance(event, RunEnded):
            found[SMOOTHED] += event.smoothed
        else:
            found[FILTERED] += event.step.filtered
            found[SMOOTHED] += event.step.smoothed
    return found, time.process_time() - begin


def _events(
    config: TrackerConfig, scenario: Scenario, reports: Sequence[SimulatedReport]
) -> Iterator[Event]:
    feed = Feed(config, Tally(config))
    poses = iter(scenario.poses())
    posed_ns = -1
    for report in reports:
        while posed_ns < report.stamp_ns and (known := next(poses, None)) is not None:
            posed_ns = known[0]
            for topic, carried in config.radars_by_platform.items():
                yield from feed.add_poses(topic, [RadarPose(own, *known) for own in carried])
        bias = config.radars[report.radar].bias
        stamp_ns, detections = bias.remove_from(report.stamp_ns, report.detections)
        yield from feed.report(report.radar, Received(stamp_ns, detections, Counter())) or ()
    yield from feed.flush()


def at_stamps(
    found: Sequence[Estimates], stamps_ns: Sequence[int], oldest_s: float
) -> list[PointSet]:
    """Return the newest estimates at each stamp, predicted to it; none is older than `oldest_s`."""
    ordered = sorted(found, key=lambda estimates: estimates.stamp_ns)
    known_ns = [estimates.stamp_ns for estimates in ordered]
    points = []
    for stamp_ns in stamps_ns:
        last = int(np.searchsorted(known_ns, stamp_ns, side="right")) - 1
        if last < 0 or stamp_ns - known_ns[last] > oldest_s * 1e9:
            points.append(PointSet(np.zeros((0, 2)), np.zeros(0, dtype=np.int64)))
            continue
        newest = ordered[last]
        position = newest.position + (stamp_ns - known_ns[last]) * 1e-9 * newest.velocity
        points.append(
            PointSet(
                position,
                newest.class_id,
                track_id=newest.track_id,
                velocity=newest.velocity,
                velocity_covariance=newest.velocity_covariance,
                height=_heights_after(newest, (stamp_ns - known_ns[last]) * 1e-9),
                coasting=newest.track_state == COASTING,
            )
        )
    return points


def _heights_after(found: Estimates, seconds: float) -> FloatArray | None:
    """Return predicted heights, metres; None if no radar reports heights."""
    if found.attributes is None:
        return None
    height: FloatArray = found.attributes.height @ np.array([1.0, seconds])
    return height
