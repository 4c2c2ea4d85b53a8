"""Simulates the plots of a turning radar: targets, clutter, reflectors and mirrored replies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.radar_parameters import RadarParameters
from phd_jdtc_ros.core.arrays import FloatArray, IntArray, wrap_angle
from phd_jdtc_ros.core.types import FULL_TURN

from .antenna import Antenna
from .looks import looks, looks_beside, passes
from .noise import Observed
from .scenario import Scenario
from .simulate import false_detections, observe, range_rates
from .traffic.flight import Flight, Leg


class SimulatedPlots(NamedTuple):
    """The plots of one radar in a run."""

    # Turns of the antenna from the start of scan 0's turn to the measured azimuth, ascending, (M,).
    turns: FloatArray
    # (M, 2). Range and azimuth; slant range and azimuth from true east for a radar with a site.
    measurement: FloatArray
    amplitude: FloatArray  # (M,)
    source: IntArray  # (M,). The track_id of each plot's target; 0 for clutter.
    # (M,). The track_id of the target whose transponder replies; set also for a mirrored reply,
    # whose source is clutter.
    answering: IntArray
    range_rate: FloatArray | None = None  # (M,)

    def take(self, rows: IntArray) -> SimulatedPlots:
        """Return the plots of some rows."""
        return SimulatedPlots._make(None if column is None else column[rows] for column in self)


def plots_of(
    scenario: Scenario, index: int, rng: np.random.Generator, layout: RadarParameters | None = None
) -> SimulatedPlots:
    """Return the plots of one radar, with clutter, ordered by time.

    `layout` has the radar's site on the round earth; None if it measures over a plane.
    """
    radar, antenna = scenario.radars[index], scenario.antennas[index]
    own = looks(scenario, index, layout)
    snr = np.array([0.0, *(flight.snr for flight in scenario.flights)])[own.source]
    observed = observe(own.exact, snr, radar, rng)
    turns = antenna.turns_at(own.time_s, radar.rotation_s)
    targets = _detected(antenna, turns, own.exact, observed, own.source, own.source)
    parts = (
        targets,
        _clutter(scenario, index, rng),
        *_reflector_plots(scenario, index, rng),
        *_mirror_plots(scenario, index, layout, rng),
    )
    columns = zip(*(part[:5] for part in parts), strict=True)
    every = SimulatedPlots(*map(np.concatenate, columns))
    others = len(every.turns) - len(targets.turns)
    range_rate = range_rates(own.state[observed.seen], others, radar, rng)
    every = every._replace(range_rate=range_rate)
    return every.take(np.argsort(every.turns, kind="stable"))


def _detected(
    antenna: Antenna,
    turns: FloatArray,
    exact: FloatArray,
    observed: Observed,
    source: IntArray,
    answering: IntArray,
) -> SimulatedPlots:
    """Return the plots that a radar detects.

    The antenna points at the true azimuths, of `exact` (N, 2), at `turns`, (N,).
    """
    moved = wrap_angle(observed.measurement[:, 1] - exact[:, 1]) / FULL_TURN
    turned = turns + (-moved if antenna.clockwise else moved)
    every = SimulatedPlots(turned, observed.measurement, observed.amplitude, source, answering)
    return every.take(np.flatnonzero(observed.seen))


def _reflector_plots(
    scenario: Scenario, index: int, rng: np.random.Generator
) -> Iterator[SimulatedPlots]:
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
        true, turned = np.concatenate(exact), np.concatenate(turns)
        none = np.zeros(len(true), dtype=np.int64)
        yield _detected(antenna, turned, true, kind.measure(true, radar, rng), none, none)


def _mirror_plots(
    scenario: Scenario, index: int, layout: RadarParameters | None, rng: np.random.Generator
) -> Iterator[SimulatedPlots]:
    """Yield a radar's plots of each target's replies by each mirror."""
    radar, antenna = scenario.radars[index], scenario.antennas[index]
    axes = list(radar.space.position)
    for mirror in scenario.mirrors:
        for number, flight in enumerate(scenario.flights, start=1):
            if not scenario.has_transponder(number):
                continue
            own = looks_beside(scenario, index, layout, number, mirror.position)
            position = own.state[:, axes]
            detour = mirror.detour(position, radar)
            exact = own.exact + np.stack([detour, np.zeros(len(detour))], axis=1)
            observed = observe(exact, np.full(len(exact), flight.snr), radar, rng)
            reflected = observed.seen & mirror.reflects(position, radar, rng)
            turns = antenna.turns_at(own.time_s, radar.rotation_s)
            none = np.zeros(len(exact), dtype=np.int64)
            observed = observed._replace(seen=reflected)
            yield _detected(antenna, turns, exact, observed, none, own.source)


def _clutter(scenario: Scenario, index: int, rng: np.random.Generator) -> SimulatedPlots:
    """Return one radar's clutter in its field of view; the clutter rate is per whole turn."""
    radar, antenna = scenario.radars[index], scenario.antennas[index]
    end = antenna.turns_at(np.array([scenario.duration_s]), radar.rotation_s)
    last = int(np.ceil(end[0]))
    count = rng.poisson(radar.clutter_rate, last)
    measurement, amplitude = false_detections(radar, int(count.sum()), rng, scenario.law(index))
    turns = np.repeat(np.arange(last), count) + antenna.turns_to(measurement[:, 1])
    none = np.zeros(len(turns), dtype=np.int64)
    kept = np.flatnonzero(radar.visibility.sees(measurement) > 0.0)
    return SimulatedPlots(turns, measurement, amplitude, none, none).take(kept)


def plot_times(scenario: Scenario, index: int, plots: SimulatedPlots) -> FloatArray:
    """Return the times of one radar's plots, seconds after scan 0, shape (M,)."""
    return scenario.antennas[index].times_at(plots.turns, scenario.radars[index].rotation_s)
