"""Simulates turning radars: plots with their own times, reported by revolution or by sector.

::

    Scenario, seed
      |  passes of the beam over targets         TurningRadar
      |  detection, noise, clutter               plots_of
    SimulatedPlots of a radar, ordered by time
      |  by revolution or by sector                    reports_of
      |  slant ranges to the plane               _read
    SimulatedReport: stamp, detections, sources

A seed gives the same plots whether they are reported by revolution or by sector.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray, wrap_angle
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.site import MIN_SLANT_RANGE, HeightProjection, to_ground
from phd_jdtc_ros.core.types import FULL_TURN, UNKNOWN, Coverage, Detections, Truth

from .antenna import Antenna, Observation
from .scenario import Scenario, truth_at
from .simulate import (
    detect_scan,
    false_detections,
    observe,
    range_rates,
    scan_replies,
    simulate_with_sources,
)
from .targets import Flight, Leg


class Looks(NamedTuple):
    """The passes of one radar's beam over targets."""

    time_s: FloatArray  # Seconds after scan 0, ascending for each target, (N,)
    state: FloatArray  # State of the target at the pass, (N, D)
    exact: FloatArray  # Noise-free measurement, as in `SimulatedPlots.measurement`, (N, Z)
    source: IntArray  # The track_id of the target, (N,)


@dataclass(frozen=True)
class TurningRadar:
    """A turning radar of a scenario."""

    scenario: Scenario
    index: int  # Index of the radar in the scenario
    layout: RadarParameters  # Its messages, and its site if it is on the round earth

    @property
    def model(self) -> RadarModel:
        """The radar, without its biases and its platform."""
        return self.scenario.radars[self.index]

    @property
    def antenna(self) -> Antenna:
        """The radar's antenna."""
        return self.scenario.antennas[self.index]

    def revolutions_at(self, time_s: FloatArray) -> FloatArray:
        """Return the antenna's revolutions at times, s after scan 0; see `Antenna`."""
        return self.antenna.revolutions_at(time_s, self.model.rotation_s)

    def times_at(self, revolutions: FloatArray) -> FloatArray:
        """Return the times of revolutions, s after scan 0; the inverse of `revolutions_at`."""
        return self.antenna.times_at(revolutions, self.model.rotation_s)

    @property
    def end(self) -> float:
        """The antenna's revolutions at the end of the run."""
        return float(self.revolutions_at(np.array([self.scenario.duration_s]))[0])

    def states(
        self, flight: Flight, time_s: FloatArray, heights: FloatArray | None = None
    ) -> FloatArray:
        """Return the states of a flight at times with the axes that the radar measures, (N, D).

        `heights`, (N, 2), replace the heights and climb rates of the flight.
        """
        state = flight.states(time_s)
        if not self.model.space.vertical:
            return state
        return np.column_stack([state, flight.heights(time_s) if heights is None else heights])

    def measure(self, state: FloatArray, time_s: FloatArray, height: FloatArray) -> FloatArray:
        """Return noise-free measurements of states at times, with slant ranges at a site, (N, Z).

        `height`, (N,), is above the world's zero, metres.
        """
        plane = self.scenario.measure(self.index, state, time_s)
        if self.layout.site is None:
            return plane
        above = height + self.layout.datum
        distance, azimuth = self.layout.site.to_slant(plane[:, 0], plane[:, 1], above)
        return np.stack([distance, wrap_angle(azimuth)], axis=1)

    def passes(self, flight: Flight) -> FloatArray:
        """Return the times at which the beam passes a target, seconds after scan 0, ascending.

        The target moves while the beam turns. Its bearing is unwrapped over the revolutions, so
        that a target that crosses the y axis is passed exactly once. Each step turns the beam to
        the target's position at the time of the previous step.
        """
        rotation_s = self.model.rotation_s
        end = min(flight.end_s, self.scenario.duration_s)
        # Revolutions are added for targets that circle the radar, which are passed more often than
        # the beam turns.
        grid = np.arange(flight.start_s - rotation_s, end + 8 * rotation_s, rotation_s)

        def bearing_revolutions(time_s: FloatArray) -> FloatArray:
            plane = self.scenario.measure(self.index, self.states(flight, time_s), time_s)
            return self.antenna.revolutions_to(plane[:, 1])

        unwrapped = np.unwrap(bearing_revolutions(grid), period=1.0)
        first = np.floor(self.revolutions_at(grid[:1]) - unwrapped[0])
        time = self.times_at(first + np.arange(len(grid)) + unwrapped)
        # Fixed-point steps for the time of a pass; the beam is far faster than any target, so that
        # each step greatly reduces the error.
        for _ in range(12):
            error = bearing_revolutions(time) - self.revolutions_at(time)
            time = time + (error - np.round(error)) * rotation_s
        time = np.sort(time[(time >= flight.start_s) & (time <= end)])
        # Solutions closer than this are the same pass, to which several steps may converge near the
        # radar.
        return time[np.diff(time, prepend=-np.inf) > 1e-3]

    def looks(self) -> Looks:
        """Return the passes over all targets.

        Targets in gaps are left out; targets outside the radar's ranges and azimuths are not.
        """
        axes, components = len(self.model.space), len(self.model.components)
        nothing = np.zeros(0), np.zeros((0, axes)), np.zeros((0, components))
        parts = [Looks(*nothing, np.zeros(0, dtype=np.int64))]
        for number, flight in enumerate(self.scenario.flights, start=1):
            time = self.passes(flight)
            seen = self._is_among_nearest(flight, time) & ~self.scenario.is_hidden(number, time)
            parts.append(self._looks_at(number, time[seen]))
        return Looks(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def looks_beside(self, number: int, place: tuple[float, float]) -> Looks:
        """Return a target's states when the beam points at a place, metres in the world.

        The noise-free measurement has the target's range and the azimuth of the place.
        """
        state, zero = np.zeros((1, len(self.model.space))), np.zeros(1)
        state[:, list(self.model.space.position)] = place
        plane = self.scenario.measure(self.index, state, zero)
        time = self.times_at(
            self.antenna.revolutions_to(plane[:, 1]) + np.arange(np.ceil(self.end))
        )
        flight = self.scenario.flights[number - 1]
        time = time[(time >= max(flight.start_s, 0.0)) & (time <= flight.end_s)]
        found = self._looks_at(number, time[~self.scenario.is_hidden(number, time)])
        azimuth = self.measure(state, zero, zero)[0, 1]
        found.exact[:, 1] = azimuth
        return found

    def _looks_at(self, number: int, time_s: FloatArray) -> Looks:
        """Return the looks at a target at given times, without those outside the elevations."""
        flight = self.scenario.flights[number - 1]
        heights = self.scenario.heights(number, time_s)
        height, state = heights[:, 0], self.states(flight, time_s, heights)
        exact = self.measure(state, time_s, height)
        found = Looks(time_s, state, exact, np.full(len(time_s), number))
        if self.layout.site is None:
            return found
        distance, azimuth = exact.T
        above = height + self.layout.datum
        far = np.maximum(distance, MIN_SLANT_RANGE)
        sine = self.layout.site.elevation_of(far, azimuth, above)
        inside = (sine >= np.sin(self.antenna.lowest)) & (sine <= np.sin(self.antenna.highest))
        return Looks(*(column[inside] for column in found))

    def _is_among_nearest(self, flight: Flight, time_s: FloatArray) -> BoolArray:
        """Return whether the radar is among the `most_radars` nearest to a target, shape (N,)."""
        scenario = self.scenario
        if not scenario.most_radars:
            return np.ones(len(time_s), dtype=np.bool_)
        state = self.states(flight, time_s)
        exact = [scenario.measure(k, state, time_s) for k in range(len(scenario.radars))]
        sees = [
            radar.visibility.probability_in_view(z) > 0.0
            for radar, z in zip(scenario.radars, exact, strict=True)
        ]
        distance = np.where(sees, [z[:, 0] for z in exact], np.inf)
        nearer: BoolArray = (distance < distance[self.index]).sum(axis=0) < scenario.most_radars
        return nearer


class SimulatedPlots(NamedTuple):
    """The plots of one radar in a run."""

    # Revolutions of the antenna from the start of scan 0's revolution to the measured azimuth,
    # ascending, (M,).
    revolutions: FloatArray
    # Range and azimuth, and elevation in space, (M, Z); slant range and azimuth from true east for
    # a radar with a site.
    measurement: FloatArray
    amplitude: FloatArray  # (M,)
    source: IntArray  # The track_id of each plot's target, (M,); 0 for clutter
    # The track_id of the target whose transponder replies, (M,); set also for a mirrored reply,
    # whose source is clutter.
    replying: IntArray
    range_rate: FloatArray | None = None  # (M,)

    def take(self, rows: IntArray) -> SimulatedPlots:
        """Return the plots of some rows."""
        return SimulatedPlots._make(None if column is None else column[rows] for column in self)


def plots_of(radar: TurningRadar, rng: np.random.Generator) -> SimulatedPlots:
    """Return the plots of one radar, with clutter, ordered by time."""
    own = radar.looks()
    snr = np.array([0.0, *(flight.snr for flight in radar.scenario.flights)])[own.source]
    observed = observe(own.exact, snr, radar.model, rng)
    targets = _detect(radar, own.time_s, own.exact, observed, own.source, own.source)
    parts = (
        targets,
        _clutter(radar, rng),
        *_reflector_plots(radar, rng),
        *_mirror_plots(radar, rng),
    )
    columns = zip(*(part[:5] for part in parts), strict=True)
    plots = SimulatedPlots(*map(np.concatenate, columns))
    others = len(plots.revolutions) - len(targets.revolutions)
    range_rate = range_rates(own.state[observed.seen], others, radar.model, rng)
    plots = plots._replace(range_rate=range_rate)
    return plots.take(np.argsort(plots.revolutions, kind="stable"))


def _detect(
    radar: TurningRadar,
    time_s: FloatArray,
    exact: FloatArray,
    observed: Observation,
    source: IntArray,
    replying: IntArray,
) -> SimulatedPlots:
    """Return the plots that a radar detects.

    The antenna points at the true azimuths, of `exact` (N, Z), at `time_s`, (N,).
    """
    moved = wrap_angle(observed.measurement[:, 1] - exact[:, 1]) / FULL_TURN
    revolutions = radar.revolutions_at(time_s) + (-moved if radar.antenna.clockwise else moved)
    plots = SimulatedPlots(revolutions, observed.measurement, observed.amplitude, source, replying)
    return plots.take(np.flatnonzero(observed.seen))


def _reflector_plots(radar: TurningRadar, rng: np.random.Generator) -> Iterator[SimulatedPlots]:
    whole = (Leg(max(radar.scenario.duration_s, radar.model.rotation_s)),)
    for kind in radar.scenario.reflectors:
        exact, times = [np.zeros((0, len(radar.model.components)))], [np.zeros(0)]
        for point in kind.points:
            still = Flight(0, 0.0, 0.0, point, (0.0, 0.0), whole)
            time = radar.passes(still)
            exact.append(radar.scenario.measure(radar.index, radar.states(still, time), time))
            times.append(time)
        true, time = np.concatenate(exact), np.concatenate(times)
        none = np.zeros(len(true), dtype=np.int64)
        yield _detect(radar, time, true, kind.measure(true, radar.model, rng), none, none)


def _mirror_plots(radar: TurningRadar, rng: np.random.Generator) -> Iterator[SimulatedPlots]:
    """Yield a radar's plots of each target's replies by each mirror."""
    axes = list(radar.model.space.position)
    for mirror in radar.scenario.mirrors:
        for number, flight in enumerate(radar.scenario.flights, start=1):
            if not radar.scenario.has_transponder(number):
                continue
            own = radar.looks_beside(number, mirror.position)
            position = own.state[:, axes]
            own.exact[:, 0] += mirror.detour(position, radar.model)
            snr = np.full(len(own.exact), flight.snr)
            observed = observe(own.exact, snr, radar.model, rng)
            reflected = observed.seen & mirror.reflects(position, radar.model, rng)
            observed = observed._replace(seen=reflected)
            none = np.zeros(len(snr), dtype=np.int64)
            yield _detect(radar, own.time_s, own.exact, observed, none, own.source)


def _clutter(radar: TurningRadar, rng: np.random.Generator) -> SimulatedPlots:
    """Return one radar's clutter in its field of view; the clutter rate is per whole revolution."""
    last, model = int(np.ceil(radar.end)), radar.model
    count = rng.poisson(model.clutter_rate, last)
    law = radar.scenario.law(radar.index)
    measurement, amplitude = false_detections(model, int(count.sum()), rng, law)
    revolutions = np.repeat(np.arange(last), count) + radar.antenna.revolutions_to(
        measurement[:, 1]
    )
    none = np.zeros(len(revolutions), dtype=np.int64)
    kept = np.flatnonzero(model.visibility.probability_in_view(measurement) > 0.0)
    return SimulatedPlots(revolutions, measurement, amplitude, none, none).take(kept)


# Detection types, the TYP of I048/020.
PRIMARY, COMBINED = 1, 3


class SimulatedReport(NamedTuple):
    """One message of a radar."""

    radar: int  # Index in the scenario
    stamp_ns: int  # End of the revolution or of the sector
    detections: Detections
    source: IntArray  # The track_id of each detection's target, (M,); 0 for clutter


def simulate_reports(
    scenario: Scenario, inputs: Sequence[RadarParameters], seed: int
) -> list[SimulatedReport]:
    """Return the reports of all radars, ordered by stamp and then by radar.

    Each of `inputs` gives a radar's number of sectors per revolution and the fields of its
    messages; detections have only these.
    """
    reports = []
    for index, (radar, layout) in enumerate(zip(scenario.radars, inputs, strict=True)):
        rng = _generator(seed, index)
        if radar.rotation_s > 0.0:
            turning = TurningRadar(scenario, index, layout)
            reports += reports_of(turning, plots_of(turning, rng), seed)
        else:
            reports += _staring_reports(scenario, index, layout, rng, seed)
    for place, report in enumerate(reports):
        bias = scenario.bias(report.radar)
        stamp_ns, found = bias.apply_to(report.stamp_ns, report.detections)
        reports[place] = report._replace(stamp_ns=stamp_ns, detections=found)
    return sorted(reports, key=lambda report: (report.stamp_ns, report.radar))


def truth_and_reports(
    scenario: Scenario, inputs: Sequence[RadarParameters], seed: int
) -> tuple[list[Truth], list[SimulatedReport]]:
    """Return the truth at every scan and the reports of all radars, both ordered by stamp.

    Reports of a scan of staring radars have its stamp; see `simulate_reports` for the others.
    """
    if scenario.turning:
        truths = [truth_at(scenario, scan) for scan in range(scenario.scans)]
        return truths, simulate_reports(scenario, inputs, seed)
    run = simulate_with_sources(scenario, seed)
    reports = [
        SimulatedReport(index, scan.stamp_ns, found, sources[index])
        for _, scan, sources in run
        for index, found in enumerate(scan.detections)
        if found is not None
    ]
    return [truth for truth, _, _ in run], reports


def check_sites(inputs: Sequence[RadarParameters]) -> None:
    """Refuse radars on the round earth that stare or measure elevations."""
    faults = [
        f"{radar.name}.rotation_s: 0 given, must be above 0 to simulate a radar with geodetic"
        if not radar.rotation_s
        else f"{radar.name}.geodetic: given, must be empty to simulate a radar with state: space"
        for radar in inputs
        if radar.site is not None and not (radar.rotation_s and radar.height_prior is None)
    ]
    if faults:
        raise ConfigError(*faults)


def plots_with_replies(radar: TurningRadar, seed: int) -> tuple[SimulatedPlots, Detections]:
    """Return the plots of a turning radar from scan 0 on, and the same as detections.

    The detections have the radar's biases, and all replies and a detection type even if the radar's
    messages have no fields for them; their ranges are slant ranges if the radar has a site. Their
    times are those of the plots' revolutions.
    """
    plots = plots_of(radar, _generator(seed, radar.index))
    time_s = radar.times_at(plots.revolutions)
    found = _with_replies(radar, plots, time_s, seed)
    found = replace(found, amplitude=None, range_rate=None)
    if radar.scenario.transponders is None:
        found = replace(found, height=_heights(radar.scenario, plots.source, time_s))
    bias = radar.scenario.bias(radar.index)
    _, found = bias.apply_to(0, replace(found, detection_type=_detection_types(found)))
    rows = np.flatnonzero(time_s >= 0.0)
    return plots.take(rows), found.take(rows)


def _generator(seed: int, index: int) -> np.random.Generator:
    """Return the generator of a radar, which is independent of the other radars."""
    return np.random.default_rng([seed, index])


def reports_of(radar: TurningRadar, plots: SimulatedPlots, seed: int = 0) -> list[SimulatedReport]:
    """Return one report per revolution or sector of a radar, also without plots.

    Incomplete revolutions at the start and the end of the run are omitted. `seed` is the seed of
    the replies.
    """
    scenario, antenna, layout = radar.scenario, radar.antenna, radar.layout
    # Revolutions and sectors begin at the biased azimuths that the antenna reports.
    ahead = scenario.bias(radar.index).azimuth / FULL_TURN * (-1.0 if antenna.clockwise else 1.0)
    turned, time_s = plots.revolutions + ahead, radar.times_at(plots.revolutions)
    observed = _with_replies(radar, plots, time_s, seed)
    parts = max(layout.sectors, 1)
    first = int(np.ceil(antenna.begin + ahead)) * parts
    last = int(np.floor((radar.end + ahead) * parts + 1e-9))
    edges = np.searchsorted(turned * parts, np.arange(first, last + 1))
    reports = []
    for number, begin, end in zip(range(first, last), edges[:-1], edges[1:], strict=True):
        edge = (number + 1) / parts
        end_s = float(radar.times_at(np.array(edge - ahead)))
        rows = np.arange(begin, end)
        # The lead over a uniform rotation at the plot, minus the lead at the stamp.
        lead_change_s = antenna.ahead_s(time_s[rows]) - antenna.ahead_s(np.array(end_s))
        found = replace(
            observed.take(rows),
            time_s=(turned[rows] - edge) * radar.model.rotation_s - lead_change_s,
            coverage=_coverage(antenna, number % parts, parts) if layout.sectors else None,
        )
        source = plots.source[rows]
        if scenario.transponders is not None:
            found = _read(scenario, _send(found, layout), source, time_s[rows], layout)
        elif layout.fields.height and layout.site is not None:
            found = replace(found, height=_heights(scenario, source, time_s[rows]))
        found = replace(
            found,
            amplitude=found.amplitude if layout.fields.amplitude else None,
            time_s=found.time_s if layout.fields.time else None,
        )
        stamp_ns = scenario.ns_after(end_s)
        reports.append(SimulatedReport(radar.index, stamp_ns, to_plane(found, layout), source))
    return reports


def _with_replies(
    radar: TurningRadar, plots: SimulatedPlots, time_s: FloatArray, seed: int
) -> Detections:
    """Return all plots with all replies of their targets, also those that messages omit."""
    found = Detections(plots.measurement, plots.amplitude, range_rate=plots.range_rate)
    return radar.scenario.with_replies(found, plots.replying, time_s, (seed, radar.index))


def _heights(scenario: Scenario, source: IntArray, time_s: FloatArray) -> FloatArray:
    """Return the heights of targets at times, metres; NaN for clutter."""
    height = np.full(len(source), np.nan)
    for number in np.unique(source[source > 0]).tolist():
        own = source == number
        height[own] = scenario.heights(number, time_s[own])[:, 0]
    return height


def _read(
    scenario: Scenario,
    found: Detections,
    source: IntArray,
    time_s: FloatArray,
    layout: RadarParameters,
) -> Detections:
    """Return detections with the ground ranges that a reader computes from reported heights.

    `found` has the ground ranges at the true heights. With a site, slant ranges are converted by
    `to_plane` instead, and in space they stay.
    """
    in_space = layout.height_prior is not None
    if layout.site is not None or found.height is None or in_space:
        return found
    true, reading = _heights(scenario, source, time_s), HeightProjection(layout.height)
    return replace(found, measurement=reading.at(found.measurement, true, found.height))


def to_plane(found: Detections, layout: RadarParameters) -> Detections:
    """Return detections with ranges and azimuths in the plane, as a reader converts them.

    If the radar has a site, they are slant ranges and azimuths from true east; other detections
    are returned unchanged, with heights as measurements in space.
    """
    if layout.height_prior is not None:
        return replace(found, height=None, z=found.height)
    if layout.site is None:
        return found
    height = None if found.height is None else found.height + layout.datum
    distance, azimuth = found.measurement.T
    ground = to_ground(layout.site, layout.assumed_height, distance, azimuth, height)
    return replace(
        found, measurement=np.stack([ground.distance, wrap_angle(ground.azimuth)], axis=1)
    )


def _send(found: Detections, layout: RadarParameters) -> Detections:
    """Return detections with the replies that the radar's messages contain."""
    return replace(
        found,
        code=found.code if layout.fields.code else None,
        address=found.address if layout.fields.address else None,
        height=found.height if layout.fields.height else None,
        detection_type=_detection_types(found) if layout.fields.detection_type else None,
    )


def _detection_types(replies: Detections) -> IntArray:
    """Return the detection types of a combined radar's plots: primary, or combined with a reply."""
    found = np.full(len(replies), PRIMARY)
    for known in (replies.code, replies.address):
        if known is not None:
            found[known != UNKNOWN] = COMBINED
    return found


def _coverage(antenna: Antenna, sector: int, sectors: int) -> Coverage:
    """Return the coverage of a sector; sectors count from the y axis in the antenna's sense."""
    width = FULL_TURN / sectors
    start = -(sector + 1) * width if antenna.clockwise else sector * width
    return Coverage(float(wrap_angle(np.array(np.pi / 2.0 + start))), width)


def _staring_reports(
    scenario: Scenario, index: int, layout: RadarParameters, rng: np.random.Generator, seed: int
) -> list[SimulatedReport]:
    reports = []
    for scan in range(scenario.scans):
        truth = truth_at(scenario, scan)
        found, source = detect_scan(scenario, truth, scan, index, rng)
        if not layout.fields.amplitude:
            found = replace(found, amplitude=None)
        found = _send(scan_replies(scenario, found, source, scan, index, seed), layout)
        time_s = np.full(len(source), scan * scenario.interval_s)
        found = _read(scenario, found, source, time_s, layout)
        reports.append(SimulatedReport(index, truth.stamp_ns, found, source))
    return reports
