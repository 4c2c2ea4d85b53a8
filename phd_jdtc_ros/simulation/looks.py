"""Passes of a turning radar's beam over targets, and their noise-free measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray, IntArray, wrap_angle
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.sensors.site import MIN_SLANT_RANGE

from .antenna import Antenna
from .scenario import Scenario
from .targets import Flight


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
