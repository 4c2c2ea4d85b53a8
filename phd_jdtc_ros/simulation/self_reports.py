"""What transmitters of a scenario's targets report of themselves; the block ``self_reports``.

Reports are drawn with their own random generators, so that the plots of a seed are the same without
them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from phd_jdtc_ros.configuration.parameters.reports import ReportsParameters
from phd_jdtc_ros.configuration.schema import ConfigError, parameter
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types.reports import MMSI, SPACES
from phd_jdtc_ros.transponders import messages
from phd_jdtc_ros.transponders.messages import ADSB, AIS, Heard
from phd_jdtc_ros.transponders.stream import Batch, Batches
from phd_jdtc_ros.transponders.transmitters import Dated

from .checked import mapping, pair, read, read_list
from .scenario import Scenario

# Speeds up to which class A reports every 10 and every 6 s, metres per second, and the shortest
# interval; class B reports every 30 s (ITU-R M.1371-5, annex 1, tables 1 and 2).
CLASS_A, LEAST_S, CLASS_B_S = ((14.0 * messages.KNOT, 10.0), (23.0 * messages.KNOT, 6.0)), 2.0, 30.0


@dataclass(frozen=True)
class Transmitter:
    """A transmitter; an entry of the list ``transmitters`` of a receiver."""

    # Interval of the positions of ADS-B as most receivers pass them on, seconds.
    ADSB_S = 1.0

    target: int = parameter(0, "Number of its target, from 1.", (1, 10**6), required=True)
    address: int = parameter(0, "Its MMSI or ICAO address.", (1, 2**32 - 2), required=True)
    name: str = parameter("", "Name or call sign.")
    type: int = parameter(0, "Type of ship or emitter; 0 if it says none.", (0, 255))
    class_b: bool = parameter(False, "Whether it is of class B of AIS.")
    antenna: tuple[float, float] = pair("Place ahead and left of the target's middle, m.")
    length: float = parameter(0.0, "Length of the ship, m; 0 if it says none.", (0.0, 1000.0))
    from_s: float = parameter(0.0, "Time at which it is switched on, s.", (0.0, 1e7))
    to_s: float = parameter(1e7, "Time at which it is switched off, s.", (0.0, 1e7))
    hidden: tuple[float, float] = pair("Begin and end of a time in which it is not received, s.")
    drift: tuple[float, float] = pair("Drift of false positions, m/s.")
    lies_from_s: float = parameter(0.0, "Time at which the drift begins, s.", (0.0, 1e7))
    true_velocity: bool = parameter(True, "Whether its velocity is without the drift.")

    def interval_s(self, space: int, speed: float) -> float:
        """Return the interval of its reports at a speed, seconds."""
        if space != MMSI:
            return self.ADSB_S
        if self.class_b:
            return CLASS_B_S
        return next((every for most, every in CLASS_A if speed <= most), LEAST_S)


@dataclass(frozen=True)
class Reception:
    """How a receiver hears transmitters; a block of ``self_reports``."""

    lost: float = parameter(0.15, "Probability that a report is lost.", (0.0, 0.999))
    position_std: float = parameter(8.0, "Of positions along each axis, m.", (0.0, 1e4))
    velocity_std: float = parameter(0.2, "Of velocities along each axis, m/s.", (0.0, 1e3))
    time_step_s: float = parameter(1.0, "Step of the reported times, s; 0 for none.", (0.0, 60.0))
    delay_s: tuple[float, float] = pair("Least and largest delay until the receipt, s.")
    transmitters: tuple[Transmitter, ...] = ()


class Received(NamedTuple):
    """A report with its time of receipt."""

    receipt_ns: int
    report: Dated


def receptions(
    document: Mapping[str, Any], targets: int, faults: list[str]
) -> dict[str, Reception]:
    """Return the document's ``self_reports`` by receiver; add its faults to `faults`."""
    found = {}
    block = mapping(document, "self_reports", faults)
    for name in block:
        given, prefix = mapping(block, name, faults, "self_reports."), f"self_reports.{name}."
        own = read(Reception, given, prefix, faults, ("transmitters",))
        senders = read_list(Transmitter, given, "transmitters", prefix, faults)
        faults += [
            f"{prefix}transmitters[{index}].target: {sender.target} given, must be from 1 to "
            f"{targets}, the number of targets"
            for index, sender in enumerate(senders)
            if sender.target > targets
        ]
        if own is not None:
            found[name] = replace(own, transmitters=senders)
    return found


def received(
    run: Scenario, reception: Reception, own: ReportsParameters, seed: int
) -> list[Received]:
    """Return the reports that a receiver gets, in the order of their receipt."""
    found: list[Received] = []
    for index, sender in enumerate(reception.transmitters):
        # Third word of the seeds of the reports' generators.
        rng = np.random.default_rng([seed, index, 4])
        found += _of_transmitter(run, reception, sender, own, rng)
    return sorted(found, key=lambda each: each.receipt_ns)


def batches(reports: Iterable[Received]) -> list[Batch]:
    """Return reports in batches, as the bridge collects them."""
    # Time for which reports are collected to a cloud, as by `report_bridge`.
    collected = Batches(500_000_000)
    ended = [collected.add(each.report, each.receipt_ns) for each in reports]
    return [batch for batch in (*ended, collected.finish()) if batch is not None]


def _of_transmitter(
    run: Scenario,
    reception: Reception,
    sender: Transmitter,
    own: ReportsParameters,
    rng: np.random.Generator,
) -> list[Received]:
    flight, space, plane = run.flights[sender.target - 1], SPACES.index(own.identity), own.plane
    if plane is None:
        raise ValueError(f"{own.name}: without a place on the earth")
    found: list[Received] = []
    begin_s, end_s = max(flight.start_s, sender.from_s), min(flight.end_s, run.duration_s)
    time_s, phase = begin_s, rng.random()
    while True:
        state = flight.states(np.array([time_s]))[0]
        every_s = sender.interval_s(space, float(np.hypot(state[1], state[3])))
        time_s += every_s * phase
        phase = 1.0
        if time_s > min(end_s, sender.to_s):
            return found
        noise, delay_s = rng.standard_normal(4), rng.uniform(*reception.delay_s)
        lost = rng.random() < reception.lost
        if lost or sender.hidden[0] <= time_s < sender.hidden[1]:
            continue
        state = flight.states(np.array([time_s]))[0]
        course = float(flight.courses(np.array([time_s]))[0])
        lie = np.array(sender.drift) * max(time_s - sender.lies_from_s, 0.0)
        ahead, aside = np.array([math.cos(course), math.sin(course)]), sender.antenna
        place = state[[0, 2]] + aside[0] * ahead + aside[1] * np.array([-ahead[1], ahead[0]])
        velocity = state[[1, 3]] + reception.velocity_std * noise[2:]
        if time_s > sender.lies_from_s and not sender.true_velocity:
            velocity = velocity + sender.drift
        heard = _heard(
            sender, space, plane, (place + lie + reception.position_std * noise[:2], velocity)
        )
        step = reception.time_step_s
        # Positions of a second are of any time within it.
        own_s = time_s if step == 0.0 else math.floor(time_s / step) * step + 0.5 * step
        if not sender.class_b:
            heard = heard._replace(heading=_compass(course, heard, plane))
        receipt_ns = run.ns_after(time_s + delay_s)
        found.append(Received(receipt_ns, Dated(run.ns_after(own_s), heard)))


def _compass(course: float, heard: Heard, plane: Plane) -> float:
    """Return a direction of the world in degrees clockwise from true north."""
    at = np.array([heard.latitude]), np.array([heard.longitude])
    return float(np.degrees(0.5 * np.pi + plane.convergence(*at)[0] - course) % 360.0)


def _heard(
    sender: Transmitter, space: int, plane: Plane, moved: tuple[FloatArray, FloatArray]
) -> Heard:
    (x, y), velocity = moved
    latitude, longitude = (
        float(each[0]) for each in plane.to_geodetic(np.array([x]), np.array([y]))
    )
    heard = Heard(
        space,
        sender.address,
        latitude=latitude,
        longitude=longitude,
        speed=float(np.hypot(*velocity)),
        name=sender.name,
        type=sender.type,
        network=AIS if space == MMSI else ADSB,
    )
    half = 0.5 * sender.length
    if sender.length:
        bow, stern = round(half - sender.antenna[0]), round(half + sender.antenna[0])
        # Beams are a seventh of lengths.
        port, starboard = (max(round(half / 7.0 + k * sender.antenna[1]), 1) for k in (-1, 1))
        heard = heard._replace(hull=(max(bow, 1), max(stern, 1), port, starboard))
    if space == MMSI:
        every_s = CLASS_B_S if sender.class_b else LEAST_S
        heard = heard._replace(interval_s=every_s, x_std=12.0, y_std=12.0, accurate=0)
    course = _compass(math.atan2(velocity[1], velocity[0]), heard, plane)
    return heard._replace(course=course)


def check(found: Mapping[str, Reception], receivers: Sequence[ReportsParameters]) -> None:
    """Raise `ConfigError` if the tracker has not these receivers, or they are not on the earth."""
    known = {own.name: own for own in receivers}
    faults = []
    for name in found:
        if name not in known:
            those = ", ".join(known) or "none"
            faults.append(f"self_reports.{name}: must be a sensor of kind: reports, {those}")
        elif known[name].plane is None:
            faults.append(f"self_reports.{name}: needs world_origin with a height")
    if faults:
        raise ConfigError(*faults)
