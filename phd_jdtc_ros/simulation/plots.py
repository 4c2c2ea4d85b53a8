"""Simulates the plots of a turning radar: targets, clutter, reflectors and mirrored replies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray, IntArray, wrap_angle
from phd_jdtc_ros.core.types import FULL_TURN

from .looks import TurningRadar
from .noise import Observation
from .simulate import false_detections, observe, range_rates
from .traffic.flight import Flight, Leg


class SimulatedPlots(NamedTuple):
    """The plots of one radar in a run."""

    # Revolutions of the antenna from the start of scan 0's revolution to the measured azimuth,
    # ascending, (M,).
    revolutions: FloatArray
    # Range and azimuth, (M, 2); slant range and azimuth from true east for a radar with a site.
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

    The antenna points at the true azimuths, of `exact` (N, 2), at `time_s`, (N,).
    """
    moved = wrap_angle(observed.measurement[:, 1] - exact[:, 1]) / FULL_TURN
    revolutions = radar.revolutions_at(time_s) + (-moved if radar.antenna.clockwise else moved)
    plots = SimulatedPlots(revolutions, observed.measurement, observed.amplitude, source, replying)
    return plots.take(np.flatnonzero(observed.seen))


def _reflector_plots(radar: TurningRadar, rng: np.random.Generator) -> Iterator[SimulatedPlots]:
    whole = (Leg(max(radar.scenario.duration_s, radar.model.rotation_s)),)
    for kind in radar.scenario.reflectors:
        exact, times = [np.zeros((0, 2))], [np.zeros(0)]
        for point in kind.points:
            still = Flight(0, 0.0, 0.0, point, (0.0, 0.0), whole)
            time = radar.passes(still)
            exact.append(radar.scenario.measure(radar.index, still.states(time), time))
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
            detour = mirror.detour(position, radar.model)
            exact = own.exact + np.stack([detour, np.zeros(len(detour))], axis=1)
            observed = observe(exact, np.full(len(exact), flight.snr), radar.model, rng)
            reflected = observed.seen & mirror.reflects(position, radar.model, rng)
            observed = observed._replace(seen=reflected)
            none = np.zeros(len(exact), dtype=np.int64)
            yield _detect(radar, own.time_s, exact, observed, none, own.source)


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
