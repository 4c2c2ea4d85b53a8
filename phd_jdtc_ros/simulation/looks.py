"""Passes of a turning radar's beam over targets, and their noise-free measurements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.radar_parameters import RadarParameters
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray, wrap_angle
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.slant_range import MIN_SLANT_RANGE

from .antenna import Antenna
from .platform import MovingPlatform
from .scenario import Scenario
from .traffic.flight import Flight

# Fixed-point steps for the time of a pass; the beam is far faster than any target, so that each
# step greatly reduces the error.
STEPS = 12
# Solutions closer than this are the same pass, to which several steps may converge near the radar.
SAME_PASS_S = 1e-3
# Turns added for targets that circle the radar, which are passed more often than the beam turns.
SPARE_TURNS = 8


class Looks(NamedTuple):
    """The passes of one radar's beam over targets."""

    time_s: FloatArray  # (N,). Seconds after scan 0; ascending for each target.
    state: FloatArray  # State of the target at the pass, (N, D)
    exact: FloatArray  # Noise-free measurement, in the form of `Plots.measurement`, (N, 2)
    source: IntArray  # The track_id of the target, (N,)


def passes(
    flight: Flight,
    radar: RadarModel,
    antenna: Antenna,
    until_s: float,
    carrier: MovingPlatform | None = None,
) -> FloatArray:
    """Return the times at which the beam passes a target, seconds after scan 0, ascending.

    Passes later than `until_s` are left out. `carrier` is the radar's platform; None if
    stationary.

    Notes
    -----
    The target moves while the beam turns. Its bearing is unwrapped over the turns, so that a
    target that crosses the y axis is passed exactly once. Each step turns the beam to the target's
    position at the time of the previous step.
    """
    rotation_s = radar.rotation_s
    end = min(flight.end_s, until_s)
    after = end + SPARE_TURNS * rotation_s
    grid = np.arange(flight.start_s - rotation_s, after, rotation_s)

    def part(time_s: FloatArray) -> FloatArray:
        state = flight.states(time_s)
        seen = state if carrier is None else carrier.to_platform(state, time_s)
        return antenna.turns_to(radar.measure(seen)[:, 1])

    unwrapped = np.unwrap(part(grid), period=1.0)
    first = np.floor(antenna.turns_at(grid[:1], rotation_s) - unwrapped[0])
    turn = first + np.arange(len(grid)) + unwrapped
    time = antenna.times_at(turn, rotation_s)
    for _ in range(STEPS):
        error = part(time) - antenna.turns_at(time, rotation_s)
        time = time + (error - np.round(error)) * rotation_s
    time = np.sort(time[(time >= flight.start_s) & (time <= end)])
    return time[np.diff(time, prepend=-np.inf) > SAME_PASS_S]


def looks(scenario: Scenario, index: int, layout: RadarParameters | None = None) -> Looks:
    """Return the passes of one radar's beam over all targets; see `plots_of` for the layout.

    Targets in gaps are left out; targets outside the radar's ranges and azimuths are not.
    """
    radar, antenna = scenario.radars[index], scenario.antennas[index]
    nothing = np.zeros(0), np.zeros((0, len(radar.space))), np.zeros((0, 2))
    parts = [Looks(*nothing, np.zeros(0, dtype=np.int64))]
    for number, flight in enumerate(scenario.flights, start=1):
        time = passes(flight, radar, antenna, scenario.duration_s, scenario.carrier(index))
        time = time[_among_nearest(scenario, index, flight, time) & ~scenario.hidden(number, time)]
        parts.append(_looks_at(scenario, index, layout, number, time))
    return Looks(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def looks_beside(
    scenario: Scenario,
    index: int,
    layout: RadarParameters | None,
    number: int,
    place: tuple[float, float],
) -> Looks:
    """Return a target's states when the beam points at a place, metres in the world.

    The noise-free measurement has the target's range and the azimuth of the place.
    """
    radar, antenna = scenario.radars[index], scenario.antennas[index]
    state = np.zeros((1, len(radar.space)))
    state[:, list(radar.space.position)] = place
    beside = scenario.measure(index, state, np.zeros(1))
    end = antenna.turns_at(np.array([scenario.duration_s]), radar.rotation_s)[0]
    turns = antenna.turns_to(beside[:, 1]) + np.arange(np.ceil(end))
    time = antenna.times_at(turns, radar.rotation_s)
    flight = scenario.flights[number - 1]
    time = time[(time >= max(flight.start_s, 0.0)) & (time <= flight.end_s)]
    found = _looks_at(scenario, index, layout, number, time[~scenario.hidden(number, time)])
    azimuth = slant(layout, beside, np.zeros(1))[0, 1]
    exact = np.stack([found.exact[:, 0], np.full(len(found.exact), azimuth)], axis=1)
    return found._replace(exact=exact)


def _looks_at(
    scenario: Scenario, index: int, layout: RadarParameters | None, number: int, time_s: FloatArray
) -> Looks:
    """Return a radar's looks at a target at given times, without those outside its elevations."""
    state = scenario.flights[number - 1].states(time_s)
    height = scenario.height(number, time_s)
    exact = slant(layout, scenario.measure(index, state, time_s), height)
    found = Looks(time_s, state, exact, np.full(len(time_s), number))
    antenna = scenario.antennas[index]
    if layout is None or layout.site is None:
        return found
    distance, azimuth = exact.T
    above = height + layout.datum
    sine = layout.site.elevation_of(np.maximum(distance, MIN_SLANT_RANGE), azimuth, above)
    inside = (sine >= np.sin(antenna.lowest)) & (sine <= np.sin(antenna.highest))
    return Looks(*(column[inside] for column in found))


def slant(layout: RadarParameters | None, measured: FloatArray, height: FloatArray) -> FloatArray:
    """Return (range, azimuth) as measured by a radar on the round earth; others unchanged.

    `measured`, (N, 2), is in the plane; `height`, (N,), is above the world's zero, metres.
    """
    if layout is None or layout.site is None:
        return measured
    above = height + layout.datum
    distance, azimuth = layout.site.to_slant(measured[:, 0], measured[:, 1], above)
    return np.stack([distance, wrap_angle(azimuth)], axis=1)


def _among_nearest(scenario: Scenario, index: int, flight: Flight, time_s: FloatArray) -> BoolArray:
    """Return whether a radar is among the `most_radars` nearest to a target, shape (N,)."""
    if not scenario.most_radars:
        return np.ones(len(time_s), dtype=np.bool_)
    state = flight.states(time_s)
    exact = [scenario.measure(k, state, time_s) for k in range(len(scenario.radars))]
    sees = [radar.visibility.sees(z) > 0.0 for radar, z in zip(scenario.radars, exact, strict=True)]
    distance = np.where(sees, [z[:, 0] for z in exact], np.inf)
    nearer: BoolArray = (distance < distance[index]).sum(axis=0) < scenario.most_radars
    return nearer
