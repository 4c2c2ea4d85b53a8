"""Simulates turning radars: plots with their own times, reported by turn or by sector.

::

    Scenario, seed
      |  passes of the beam over targets         passes, looks
      |  detection, noise, clutter               plots_of
    Plots of a radar, ordered by time
      |  by turn or by sector                    reports_of
      |  slant ranges to the plane               to_plane
    Report: stamp, detections, sources

A seed gives the same plots whether they are reported by turn or by sector.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.radar_input import RadarInput
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import FloatArray, IntArray, wrap_angle
from phd_jdtc_ros.core.sensors.slant_range import HeightReading, over_ground
from phd_jdtc_ros.core.types import FULL_TURN, UNKNOWN, Coverage, Detections

from .antenna import Antenna
from .looks import looks, looks_beside, passes
from .scenario import Scenario, truth_at
from .simulate import detect, false_detections, observe, range_rates
from .traffic.flight import Flight, Leg

# Kinds of plots, the TYP of I048/020.
PRIMARY, COMBINED = 1, 3


class Report(NamedTuple):
    """One message of a radar.

    Parameters
    ----------
    radar : int
        Index in the scenario.
    stamp_ns : int
        End of the turn or of the sector.
    source : int array of shape (M,)
        The track_id of each detection's target; 0 for clutter.
    """

    radar: int
    stamp_ns: int
    detections: Detections
    source: IntArray


class Plots(NamedTuple):
    """The plots of one radar in a run.

    Parameters
    ----------
    turns : array of shape (M,)
        Turns of the antenna from the start of scan 0's turn to the measured azimuth, ascending.
    measurement : array of shape (M, 2)
        Range and azimuth; slant range and azimuth from true east for a radar with a site.
    amplitude : array of shape (M,)
    source : int array of shape (M,)
        The track_id of each plot's target; 0 for clutter.
    answering : int array of shape (M,)
        The track_id of the target whose transponder replies; set also for a mirrored reply, whose
        source is clutter.
    range_rate : array of shape (M,) or None
    """

    turns: FloatArray
    measurement: FloatArray
    amplitude: FloatArray
    source: IntArray
    answering: IntArray
    range_rate: FloatArray | None = None

    def take(self, rows: IntArray) -> Plots:
        """Return the plots of some rows."""
        rate = None if self.range_rate is None else self.range_rate[rows]
        turns, measurement, amplitude, source, answering, _ = self
        return Plots(
            *(turns[rows], measurement[rows], amplitude[rows]),
            *(source[rows], answering[rows], rate),
        )


def simulate_reports(scenario: Scenario, inputs: Sequence[RadarInput], seed: int) -> list[Report]:
    """Return the reports of all radars, ordered by stamp and then by radar.

    Parameters
    ----------
    inputs : sequence of RadarInput
        One per radar: number of sectors per turn, and whether its messages have times and
        amplitudes. Detections have only the fields of the messages.
    """
    reports = []
    for index, (radar, layout) in enumerate(zip(scenario.radars, inputs, strict=True)):
        rng = _generator(seed, index)
        if radar.rotation_s > 0.0:
            plots = plots_of(scenario, index, rng, layout)
            reports += reports_of(scenario, index, plots, layout, seed)
        else:
            reports += _still_reports(scenario, index, layout, rng, seed)
    reports = [_biased(report, scenario) for report in reports]
    return sorted(reports, key=lambda report: (report.stamp_ns, report.radar))


def check_sites(inputs: Sequence[RadarInput]) -> None:
    """Refuse staring radars on the round earth, which are simulated over a plane only."""
    faults = [
        f"{radar.name}.rotation_s: 0 given, must be above 0 to simulate a radar with geodetic"
        for radar in inputs
        if radar.site is not None and not radar.rotation_s
    ]
    if faults:
        raise ConfigError(faults)


def plots_with_replies(
    scenario: Scenario, index: int, layout: RadarInput, seed: int
) -> tuple[Plots, Detections]:
    """Return the plots of a turning radar from scan 0 on, and the same as detections.

    The detections have the radar's biases, all replies of its targets and a sensor type,
    independent of the message `layout`; their ranges are slant ranges if the radar has a site.
    Their times are `plot_times`.
    """
    plots = plots_of(scenario, index, _generator(seed, index), layout)
    found = _answers(scenario, index, plots, seed)
    if scenario.transponders is None:
        every = slice(0, len(plots.turns))
        found = replace(found, height=_heights(scenario, index, plots, every))
    _, found = scenario.bias(index).apply_to(0, replace(found, kind=_kind(found)))
    rows = np.flatnonzero(plot_times(scenario, index, plots) >= 0.0)
    return plots.take(rows), found.take(rows)


def _generator(seed: int, index: int) -> np.random.Generator:
    """Return the generator of a radar, which is independent of the other radars."""
    return np.random.default_rng([seed, index])


def _biased(report: Report, scenario: Scenario) -> Report:
    """Return a report with the biases of its radar."""
    stamp_ns, found = scenario.bias(report.radar).apply_to(report.stamp_ns, report.detections)
    return report._replace(stamp_ns=stamp_ns, detections=found)


def plots_of(
    scenario: Scenario, index: int, rng: np.random.Generator, layout: RadarInput | None = None
) -> Plots:
    """Return the plots of one radar, with clutter, ordered by time.

    `layout` has the radar's site on the round earth; None if it measures over a plane.
    """
    radar, antenna = scenario.radars[index], scenario.antennas[index]
    _, state, true, source = own = looks(scenario, index, layout)
    snr = np.array([0.0, *(flight.snr for flight in scenario.flights)])[source]
    found, amplitude, seen = observe(true, snr, radar, rng)
    turned = _plot_turns(antenna, antenna.turns_at(own.time_s, radar.rotation_s), true, found)
    targets = Plots(turned[seen], found[seen], amplitude[seen], source[seen], source[seen])
    parts = (
        targets,
        _clutter(scenario, index, rng),
        *_reflector_plots(scenario, index, rng),
        *_mirror_plots(scenario, index, layout, rng),
    )
    turned = np.concatenate([part.turns for part in parts])
    others = len(turned) - len(targets.turns)
    range_rate = range_rates(state[seen], others, radar, rng)
    every = Plots(
        turned,
        np.concatenate([part.measurement for part in parts]),
        np.concatenate([part.amplitude for part in parts]),
        np.concatenate([part.source for part in parts]),
        np.concatenate([part.answering for part in parts]),
        range_rate,
    )
    return every.take(np.argsort(turned, kind="stable"))


def _plot_turns(
    antenna: Antenna, turns: FloatArray, exact: FloatArray, found: FloatArray
) -> FloatArray:
    """Return the turns at which the antenna points at measured azimuths.

    Parameters
    ----------
    turns : array of shape (N,)
        Turns at which the antenna points at the true azimuths.
    exact, found : arrays of shape (N, 2)
        True and measured range and azimuth.
    """
    moved = wrap_angle(found[:, 1] - exact[:, 1]) / FULL_TURN
    return turns + (-moved if antenna.clockwise else moved)


def _reflector_plots(scenario: Scenario, index: int, rng: np.random.Generator) -> Iterator[Plots]:
    """Yield a radar's plots of each kind of reflectors."""
    radar, antenna = scenario.radars[index], scenario.antennas[index]
    whole = (Leg(max(scenario.duration_s, radar.rotation_s)),)
    for kind in scenario.reflectors:
        exact, turns = [np.zeros((0, 2))], [np.zeros(0)]
        for point in kind.points:
            still = Flight(0, 0.0, 0.0, point, (0.0, 0.0), whole)
            time = passes(still, radar, antenna, scenario.duration_s, scenario.carrier(index))
            exact.append(scenario.measure(index, still.states(time), time))
            turns.append(antenna.turns_at(time, radar.rotation_s))
        true = np.concatenate(exact)
        found, amplitude, seen = kind.answers(true, radar, rng)
        turned = _plot_turns(antenna, np.concatenate(turns), true, found)
        none = np.zeros(int(np.count_nonzero(seen)), dtype=np.int64)
        yield Plots(turned[seen], found[seen], amplitude[seen], none, none)


def _mirror_plots(
    scenario: Scenario, index: int, layout: RadarInput | None, rng: np.random.Generator
) -> Iterator[Plots]:
    """Yield a radar's plots of each target's replies by each mirror."""
    radar, antenna = scenario.radars[index], scenario.antennas[index]
    axes = list(radar.space.position)
    for mirror in scenario.mirrors:
        for number, flight in enumerate(scenario.flights, start=1):
            if not scenario.answers(number):
                continue
            own = looks_beside(scenario, index, layout, number, mirror.position)
            position = own.state[:, axes]
            exact = own.exact + np.stack(
                [mirror.detour(position, radar), np.zeros(len(position))], axis=1
            )
            snr = np.full(len(position), flight.snr)
            found, amplitude, seen = observe(exact, snr, radar, rng)
            seen &= mirror.reflects(position, radar, rng)
            turned = _plot_turns(
                antenna, antenna.turns_at(own.time_s, radar.rotation_s), exact, found
            )
            none = np.zeros(int(np.count_nonzero(seen)), dtype=np.int64)
            yield Plots(turned[seen], found[seen], amplitude[seen], none, own.source[seen])


def _clutter(scenario: Scenario, index: int, rng: np.random.Generator) -> Plots:
    """Return one radar's clutter in its field of view; the clutter rate is per whole turn."""
    radar, antenna = scenario.radars[index], scenario.antennas[index]
    end = antenna.turns_at(np.array([scenario.duration_s]), radar.rotation_s)
    last = int(np.ceil(end[0]))
    count = rng.poisson(radar.clutter_rate, last)
    measurement, amplitude = false_detections(radar, int(count.sum()), rng, scenario.law(index))
    turns = np.repeat(np.arange(last), count) + antenna.turns_to(measurement[:, 1])
    kept = radar.visibility.sees(measurement) > 0.0
    none = np.zeros(int(np.count_nonzero(kept)), dtype=np.int64)
    return Plots(turns[kept], measurement[kept], amplitude[kept], none, none)


def reports_of(
    scenario: Scenario, index: int, plots: Plots, layout: RadarInput, seed: int = 0
) -> list[Report]:
    """Return one report per turn or sector of a radar, also without plots.

    Incomplete turns at the start and the end of the run are omitted. `seed` is the seed of the
    replies.
    """
    radar, antenna = scenario.radars[index], scenario.antennas[index]
    # Turns and sectors begin by the biased azimuth that the antenna reports.
    ahead = scenario.bias(index).azimuth / FULL_TURN * (-1.0 if antenna.clockwise else 1.0)
    turned, offset = plots.turns + ahead, antenna.begin + ahead
    answers = _answers(scenario, index, plots, seed)
    time_s = plot_times(scenario, index, plots)
    parts = max(layout.sectors, 1)
    first = int(np.ceil(offset)) * parts
    end_turn = antenna.turns_at(np.array([scenario.duration_s]), radar.rotation_s)[0] + ahead
    last = int(np.floor(end_turn * parts + 1e-9))
    edges = np.searchsorted(turned * parts, np.arange(first, last + 1))
    reports = []
    for number, begin, end in zip(range(first, last), edges[:-1], edges[1:], strict=True):
        edge = (number + 1) / parts
        end_s = float(antenna.times_at(np.array(edge - ahead), radar.rotation_s))
        rows = slice(int(begin), int(end))
        # The lead over a uniform rotation at the plot, minus the lead at the stamp.
        lead_change_s = antenna.ahead_s(time_s[rows]) - antenna.ahead_s(np.array(end_s))
        own_s = (turned[rows] - edge) * radar.rotation_s - lead_change_s
        coverage = _coverage(antenna, number % parts, parts) if layout.sectors else None
        detections = _to_detections(plots, rows, own_s, coverage, layout)
        if scenario.transponders is not None:
            own = answers.take(np.arange(len(plots.turns))[rows])
            detections = _with_answers(detections, own, layout)
            detections = _read(detections, _heights(scenario, index, plots, rows), layout)
        elif layout.fields.height and layout.site is not None:
            detections = replace(detections, height=_heights(scenario, index, plots, rows))
        detections = to_plane(detections, layout)
        reports.append(Report(index, scenario.ns_after(end_s), detections, plots.source[rows]))
    return reports


def plot_times(scenario: Scenario, index: int, plots: Plots) -> FloatArray:
    """Return the times of one radar's plots, seconds after scan 0, shape (M,)."""
    return scenario.antennas[index].times_at(plots.turns, scenario.radars[index].rotation_s)


def _to_detections(
    plots: Plots, rows: slice, time_s: FloatArray, coverage: Coverage | None, layout: RadarInput
) -> Detections:
    """Return some plots as detections with the fields of the radar's messages."""
    return Detections(
        plots.measurement[rows],
        plots.amplitude[rows] if layout.fields.amplitude else None,
        time_s=time_s if layout.fields.time else None,
        coverage=coverage,
        range_rate=None if plots.range_rate is None else plots.range_rate[rows],
    )


def _heights(scenario: Scenario, index: int, plots: Plots, rows: slice) -> FloatArray:
    """Return the heights of the targets of some plots, metres; NaN for clutter."""
    return _heights_at(scenario, plots.source[rows], plot_times(scenario, index, plots)[rows])


def _heights_at(scenario: Scenario, source: IntArray, time_s: FloatArray) -> FloatArray:
    """Return the heights of targets at times, metres; NaN for clutter."""
    height = np.full(len(source), np.nan)
    for number in np.unique(source[source > 0]).tolist():
        own = source == number
        height[own] = scenario.height(number, time_s[own])
    return height


def _read(found: Detections, true: FloatArray, layout: RadarInput) -> Detections:
    """Return detections over a plane with ranges as a reader converts them, given their heights.

    Parameters
    ----------
    found : Detections
        Detections with the ground ranges of their true heights.
    true : array of shape (M,)
        True heights, metres; NaN for clutter.
    """
    if layout.site is not None or found.height is None:
        return found
    reading = HeightReading(layout.height)
    return replace(found, measurement=reading.at(found.measurement, true, found.height))


def to_plane(found: Detections, layout: RadarInput) -> Detections:
    """Return detections with ranges and azimuths in the plane, as a reader converts them.

    Parameters
    ----------
    found : Detections
        Slant ranges and azimuths from true east, if the radar has a site; other detections are
        returned unchanged.
    """
    if layout.site is None:
        return found
    height = None if found.height is None else found.height + layout.datum
    distance, azimuth = found.measurement.T
    ground = over_ground(layout.site, layout.assumed_height, distance, azimuth, height)
    return replace(
        found, measurement=np.stack([ground.distance, wrap_angle(ground.azimuth)], axis=1)
    )


def _answers(scenario: Scenario, index: int, plots: Plots, seed: int) -> Detections:
    """Return all plots with their targets' replies, independent of the messages."""
    found = Detections(plots.measurement, None)
    time_s = plot_times(scenario, index, plots)
    return scenario.with_replies(found, plots.answering, time_s, (seed, index))


def _with_answers(found: Detections, answers: Detections, layout: RadarInput) -> Detections:
    """Return detections with the replies that the radar's messages contain."""
    return replace(
        found,
        code=answers.code if layout.fields.code else None,
        address=answers.address if layout.fields.address else None,
        height=answers.height if layout.fields.height else None,
        kind=_kind(answers) if layout.fields.kind else None,
    )


def _kind(answers: Detections) -> IntArray:
    """Return the sensor types of a combined radar's plots: primary, or combined with a reply."""
    kind = np.full(len(answers), PRIMARY)
    for known in (answers.code, answers.address):
        if known is not None:
            kind[known != UNKNOWN] = COMBINED
    return kind


def _coverage(antenna: Antenna, sector: int, sectors: int) -> Coverage:
    """Return the coverage of a sector; sectors count from the y axis in the antenna's sense."""
    width = FULL_TURN / sectors
    start = -(sector + 1) * width if antenna.clockwise else sector * width
    return Coverage(float(wrap_angle(np.array(np.pi / 2.0 + start))), width)


def _still_reports(
    scenario: Scenario, index: int, layout: RadarInput, rng: np.random.Generator, seed: int
) -> list[Report]:
    """Return the reports of a staring radar, one per scan."""
    snr_of = np.array([target.snr for target in scenario.targets])
    reports = []
    for scan in range(scenario.scans):
        truth = truth_at(scenario, scan)
        snr = snr_of[truth.track_id - 1]
        radar = scenario.radar_at(index, scan * scenario.interval_s)
        laws = scenario.laws(index)
        found, source = detect(truth, snr, radar, rng, *laws, scenario.reflectors)
        if not layout.fields.amplitude:
            found = replace(found, amplitude=None)
        time_s = np.full(len(source), scan * scenario.interval_s)
        answers = scenario.with_replies(found, source, time_s, (seed, scan, index))
        found = _read(
            _with_answers(found, answers, layout), _heights_at(scenario, source, time_s), layout
        )
        reports.append(Report(index, truth.stamp_ns, found, source))
    return reports
