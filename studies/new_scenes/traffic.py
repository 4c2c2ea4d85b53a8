"""Twelve scenes: random targets, their radars, and the parameters that a user would copy.

Radars have the parameters of a shipped profile with the scene's numbers. Metres, seconds, metres
per second, radians unless a name says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.core.arrays import BoolArray, FloatArray
from phd_jdtc_ros.core.sensors.polar_radar import polar_radars
from phd_jdtc_ros.core.types import Truth
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.simulation.scenario import MovingPlatform, Scenario
from phd_jdtc_ros.simulation.targets import STANDARD_GRAVITY, Flight, Leg
from phd_jdtc_ros.simulation.turning_antenna import SimulatedReport, simulate_reports

Rng: TypeAlias = np.random.Generator
Given: TypeAlias = Mapping[str, Any]

START_NS = 1000 * 10**9
SNR = 1000.0  # Not used: detection probabilities are given, and amplitudes are not reported
AIR, ROAD, SEA = "air_traffic", "automotive", "own_ship"
LEARNED = ["noise", "outliers", "detection", "clutter"]
STARING = {"rotation_s": 0.0, "fields.time": ""}


@dataclass(frozen=True)
class Kind:
    """A kind of traffic: how its targets move, and how far apart they are."""

    densities: tuple[float, float, float]  # White acceleration of the peer's motions, m^2/s^3
    cutoff: float  # Of the scores
    near: float  # Distance along an axis within which the peer looks for two tracks of one target


KINDS = {
    AIR: Kind((0.1, 10.0, 200.0), 1000.0, 500.0),
    ROAD: Kind((0.1, 2.0, 10.0), 20.0, 5.0),
    SEA: Kind((0.001, 0.05, 0.5), 200.0, 50.0),
}


@dataclass(frozen=True)
class Scene:
    """Targets before radars, and the parameters of a tracker that knows the radars."""

    profile: str
    parameters: Given
    scenario: Scenario
    # Whether a radar, by index, reports at a time after scan 0.
    reports: Callable[[int, float], bool] = lambda radar, time_s: True

    @property
    def kind(self) -> Kind:
        """The kind of its traffic."""
        return KINDS[self.profile]

    def config(self, learned: bool) -> TrackerConfig:
        """Return the configuration of a tracker that is told the radars, or learns them too."""
        learn = {f"{radar}.learn": LEARNED if learned else [] for radar in self.names}
        return from_arguments.config_of({**self.parameters, **learn})

    @property
    def names(self) -> list[str]:
        """Names of the radars."""
        return list(self.parameters["sensors"])

    def detections(self, seed: int) -> list[SimulatedReport]:
        """Return what the radars report, by time."""
        reports = simulate_reports(self.scenario, self.config(learned=False).radars, seed)
        return [each for each in reports if self.reports(each.radar, self.after(each.stamp_ns))]

    def after(self, stamp_ns: int) -> float:
        """Return the time of a stamp after scan 0."""
        return (stamp_ns - self.scenario.start_ns) * 1e-9

    def in_sight(self, truth: Truth, time_s: float) -> BoolArray:
        """Return which targets are within the coverage of a radar that reports, (T,)."""
        seen = np.zeros(len(truth.state), dtype=np.bool_)
        for index in range(len(self.scenario.radars)):
            model = self.scenario.radar_at(index, time_s)
            if self.reports(index, time_s):
                measured = model.measure(truth.state)
                seen |= model.visibility.probability_in_view(measured) > 0.0
        return seen


def _scene(
    profile: str,
    radars: Mapping[str, Given],
    flights: Sequence[Flight],
    end_s: float,
    more: Given,
    interval_s: float = 0.0,
    **others: Any,
) -> Scene:
    """Return a scene whose scans have an interval, by default that of the tracker."""
    given = dict(from_arguments.load(resources.find(Path(f"config/{profile}.yaml"))))
    (copied,) = given["sensors"]
    own = {name: value for name, value in given.items() if name.startswith(f"{copied}.")}
    shared = {name: value for name, value in given.items() if name not in own}
    parameters = {**shared, **more, "sensors": [*radars]}
    for name, numbers in radars.items():
        known = {parameter.partition(".")[2]: value for parameter, value in own.items()}
        known |= {"frame": name, "topic": f"/{name}/detections", **numbers}
        known["clutter_max_range"] = known["max_range"]
        parameters |= {f"{name}.{parameter}": value for parameter, value in known.items()}
    step = interval_s or parameters["interval_s"]
    platform = others.pop("platform", None)
    models = polar_radars(from_arguments.config_of(parameters).model.radars)
    scenario = Scenario(
        START_NS, step, int(end_s / step) + 1, tuple(flights), models, platform=platform
    )
    return Scene(profile, parameters, scenario, **others)


def _radar(
    place: tuple[float, float],
    std: tuple[float, float],
    detection: float,
    clutter: float,
    max_range: float,
    **more: Any,
) -> dict[str, Any]:
    """Return the numbers of a radar; `std` are of ranges (m) and azimuths (degrees)."""
    return {
        "position": list(place),
        "range_std": std[0],
        "azimuth_std_deg": std[1],
        "detection_probability": [detection],
        "detection_probability_range": [0.0],
        "clutter_rate": clutter,
        "max_range": max_range,
        **more,
    }


def _turning(rotation_s: float, **more: Any) -> dict[str, Any]:
    return {"rotation_s": rotation_s, **more}


def _flight(
    place: FloatArray | Sequence[float],
    speed: float,
    course: float,
    legs: Sequence[Leg],
    start_s: float = 0.0,
) -> Flight:
    x, y = np.asarray(place, dtype=float).tolist()
    velocity = speed * math.cos(course), speed * math.sin(course)
    return Flight(0, SNR, start_s, (x, y), velocity, tuple(legs))


def _turns(rng: Rng, speed: float, left_s: float, gravities: float, count: int) -> Iterator[Leg]:
    """Yield straight legs and turns of 40 to 130 degrees of an acceleration."""
    rate = gravities * STANDARD_GRAVITY / speed
    for _ in range(count):
        turn_s = math.radians(rng.uniform(40.0, 130.0)) / rate
        straight_s = rng.uniform(0.3, 1.0) * left_s / (count + 1)
        yield Leg(straight_s)
        yield Leg(turn_s, rate * float(rng.choice([-1.0, 1.0])))
        left_s -= straight_s + turn_s
    yield Leg(max(left_s, 1.0))


def _aircraft(
    rng: Rng, count: int, half: float, end_s: float, gravities: float = 0.8, turns: int = 2
) -> list[Flight]:
    """Return aircraft that pass a square in random directions and turn."""
    found = []
    for _ in range(count):
        speed, course = rng.uniform(110.0, 250.0), rng.uniform(-math.pi, math.pi)
        way = 0.5 * speed * end_s * np.array([math.cos(course), math.sin(course)])
        place = rng.uniform(-half, half, 2) - way
        legs = _turns(rng, speed, end_s, gravities, turns)
        found.append(_flight(place, speed, course, [*legs]))
    return found


def unequal_turns(rng: Rng) -> Scene:
    """Three radars that turn in 3.7, 4.9 and 6.3 s."""
    places = {"a": (-18e3, -9e3), "b": (21e3, -6e3), "c": (2e3, 24e3)}
    turns = {"a": 3.7, "b": 4.9, "c": 6.3}
    radars = {
        name: _radar(place, (50.0, 0.12), 0.9, 15.0, 60e3, **_turning(turns[name]))
        for name, place in places.items()
    }
    more = {"reorder_s": 6.3}
    return _scene(AIR, radars, _aircraft(rng, 14, 20e3, 240.0), 240.0, more)


def asynchronous(rng: Rng) -> Scene:
    """Two staring radars of unequal intervals, 4 and 5.5 s, of which one begins 1.5 s later."""
    radars = {
        "a": _radar((-12e3, 4e3), (60.0, 0.15), 0.88, 18.0, 55e3, **STARING),
        "b": _radar((16e3, -8e3), (40.0, 0.2), 0.92, 12.0, 55e3, **STARING),
    }
    scans = ((8, 0), (11, 3))

    def reports(radar: int, time_s: float) -> bool:
        every, first = scans[radar]
        return round(2.0 * time_s) % every == first

    flights = _aircraft(rng, 14, 20e3, 220.0)
    own = {"estimates_period_s": 0.0}
    return _scene(AIR, radars, flights, 220.0, own, interval_s=0.5, reports=reports)


def formations(rng: Rng) -> Scene:
    """Five formations of three aircraft, 250 to 500 m apart, that turn together."""
    flights = []
    for _ in range(5):
        speed, course = rng.uniform(140.0, 220.0), rng.uniform(-math.pi, math.pi)
        way = 0.5 * speed * 240.0 * np.array([math.cos(course), math.sin(course)])
        place, legs = rng.uniform(-18e3, 18e3, 2) - way, [*_turns(rng, speed, 240.0, 0.5, 2)]
        left = np.array([-math.sin(course), math.cos(course)])
        for wing in (0, -1, 1):
            side = wing * rng.uniform(250.0, 500.0)
            behind = abs(wing) * rng.uniform(100.0, 300.0) * way / np.linalg.norm(way)
            flights.append(_flight(place + side * left - behind, speed, course, legs))
    radars = {"a": _radar((0.0, 0.0), (40.0, 0.1), 0.92, 15.0, 60e3, **STARING)}
    return _scene(AIR, radars, flights, 240.0, _lone())


def _lone() -> dict[str, Any]:
    """Return parameters of radars whose scans have one time."""
    return {"estimates_period_s": 0.0}


def hole(rng: Rng) -> Scene:
    """Five of nine aircraft fly through a blind sector of 50 degrees in 60 to 90 s."""
    flights = []
    for k in range(5):
        far = 13e3 + 2.2e3 * k
        width, hidden_s = 2.0 * far * math.tan(math.radians(25.0)), rng.uniform(60.0, 90.0)
        speed, enters_s = width / hidden_s, rng.uniform(80.0, 110.0)
        bend = float(rng.choice([-1.0, 1.0])) * rng.uniform(0.0, 0.0012)
        legs = Leg(enters_s + 15.0), Leg(30.0, bend), Leg(260.0)
        flights.append(_flight((-far, 0.5 * width + speed * enters_s), speed, -0.5 * math.pi, legs))
    flights += _aircraft(rng, 4, 18e3, 280.0)
    blind = {"blind_sectors_deg": [245.0, 295.0]}
    radars = {"a": _radar((0.0, 0.0), (45.0, 0.1), 0.9, 20.0, 60e3, **STARING, **blind)}
    return _scene(AIR, radars, flights, 280.0, _lone())


def shallow_crossings(rng: Rng) -> Scene:
    """Six pairs of aircraft cross at angles of 3 to 8 degrees."""
    flights = []
    for _ in range(6):
        speed, course = rng.uniform(130.0, 230.0), rng.uniform(-math.pi, math.pi)
        meet, meet_s = rng.uniform(-20e3, 20e3, 2), rng.uniform(90.0, 150.0)
        angle = math.radians(rng.uniform(3.0, 8.0))
        for side in (-0.5, 0.5):
            own, fast = course + side * angle, speed * rng.uniform(0.99, 1.01)
            place = meet - fast * meet_s * np.array([math.cos(own), math.sin(own)])
            flights.append(_flight(place, fast, own, [Leg(240.0)]))
    radars = {"a": _radar((3e3, -2e3), (50.0, 0.12), 0.9, 15.0, 60e3, **STARING)}
    return _scene(AIR, radars, flights, 240.0, _lone())


def off_and_on(rng: Rng) -> Scene:
    """Two radars, of which one is off from 90 to 170 s."""
    radars = {
        "a": _radar((-17e3, 3e3), (50.0, 0.12), 0.9, 20.0, 40e3, **STARING),
        "b": _radar((23e3, -2e3), (50.0, 0.12), 0.9, 20.0, 40e3, **STARING),
    }

    def reports(radar: int, time_s: float) -> bool:
        return radar == 0 or not 90.0 <= time_s < 170.0

    flights = _aircraft(rng, 14, 32e3, 270.0)
    return _scene(AIR, radars, flights, 270.0, _lone(), reports=reports)


def six_g(rng: Rng) -> Scene:
    """Eight aircraft turn with 6 g before a radar that turns in 2.5 s."""
    flights = _aircraft(rng, 8, 15e3, 150.0, gravities=6.0, turns=3)
    own = {"interval_s": 2.5, "estimates_period_s": 2.5, "lag_s": 12.5}
    radars = {"a": _radar((0.0, 0.0), (30.0, 0.1), 0.92, 12.0, 60e3, **_turning(2.5))}
    return _scene(AIR, radars, flights, 150.0, own)


def flood(rng: Rng) -> Scene:
    """Thirty-six aircraft appear within half a minute among four."""
    flights = _aircraft(rng, 4, 20e3, 160.0)
    for each in _aircraft(rng, 36, 22e3, 100.0, turns=1):
        # They appear on their way, not at its begin.
        middle = each.states(np.array([rng.uniform(20.0, 60.0)]))[0]
        begin = replace(each, position=tuple(middle[[0, 2]].tolist()))
        flights.append(replace(begin, start_s=rng.uniform(40.0, 70.0)))
    radars = {"a": _radar((0.0, 0.0), (45.0, 0.1), 0.9, 25.0, 60e3, **STARING)}
    return _scene(AIR, radars, flights, 160.0, _lone())


def clutter_by_range(rng: Rng) -> Scene:
    """Six low, fast targets come in where clutter is ten times as dense as far away."""
    flights, first = [], 18e3
    for _ in range(6):
        bearing, speed = rng.uniform(-math.pi, math.pi), rng.uniform(180.0, 280.0)
        rate = float(rng.choice([-1.0, 1.0])) * 2.5 * STANDARD_GRAVITY / speed
        legs = [Leg(rng.uniform(12.0, 35.0)), Leg(4.0, rate), Leg(8.0, -rate), Leg(4.0, rate)]
        left_s = first / speed - 8.0 - sum(leg.duration_s for leg in legs)
        place = first * np.array([math.cos(bearing), math.sin(bearing)])
        course = bearing + math.pi + rng.uniform(-0.1, 0.1)
        legs.append(Leg(max(left_s, 1.0)))
        flights.append(_flight(place, speed, course, legs, rng.uniform(0.0, 30.0)))
    near = np.linspace(0.0, 20e3, 9)
    own = {
        "min_range": 200.0,
        "clutter_density": np.exp(-near / 3500.0).tolist(),
        "clutter_density_range": near.tolist(),
    }
    radars = {"a": _radar((0.0, 0.0), (30.0, 0.4), 0.88, 70.0, 20e3, **STARING, **own)}
    more = {**_lone(), "interval_s": 2.0, "lag_s": 10.0, "detection_births.std": [150.0, 0.02]}
    return _scene(AIR, radars, flights, 110.0, more)


def _road_radar(clutter: float, ambiguity: float) -> dict[str, Given]:
    own = {"range_rate_ambiguity": ambiguity, "cluster_distance": 0.0}
    return {"front": _radar((0.0, 0.0), (0.3, 0.5), 0.9, clutter, 200.0, **own)}


def folded_rates(rng: Rng) -> Scene:
    """Ten cars at 8 to 34 m/s whose range rates are known modulo 24 m/s."""
    flights = []
    for k in range(10):
        speed, comes = rng.uniform(8.0, 34.0), bool(k % 2)
        lane, start_s = (4.0 if comes else -4.0) * (1 + k % 3), rng.uniform(0.0, 12.0)
        bend = rng.uniform(-0.03, 0.03)
        course = math.pi if comes else 0.0
        legs = [Leg(rng.uniform(1.0, 4.0)), Leg(3.0, bend), Leg(3.0, -bend), Leg(12.0)]
        place = (rng.uniform(130.0, 190.0) if comes else rng.uniform(10.0, 40.0), lane)
        flights.append(_flight(place, speed, course, legs, start_s))
    return _scene(ROAD, _road_radar(10.0, 24.0), flights, 20.0, {})


def yawing(rng: Rng) -> Scene:
    """Eight boats before a radar on a boat that turns to and fro."""
    legs, left_s = [], 200.0
    while left_s > 0.0:
        side = float(rng.choice([-1.0, 1.0]))
        legs += [Leg(rng.uniform(6.0, 15.0)), Leg(rng.uniform(5.0, 12.0), side * math.radians(7.0))]
        left_s -= legs[-1].duration_s + legs[-2].duration_s
    ship = MovingPlatform(_flight((0.0, 0.0), 4.0, rng.uniform(-math.pi, math.pi), legs), (0,), 0.2)
    flights = []
    for _ in range(8):
        speed, course = rng.uniform(2.0, 12.0), rng.uniform(-math.pi, math.pi)
        bearing, far = rng.uniform(-math.pi, math.pi), rng.uniform(300.0, 1800.0)
        place = far * np.array([math.cos(bearing), math.sin(bearing)])
        ways = [Leg(60.0), Leg(20.0, rng.uniform(-0.06, 0.06)), Leg(120.0)]
        flights.append(_flight(place, speed, course, ways))
    own = {"rotation_s": 2.0, "min_range": 20.0, "clutter_map": False}
    radars = {"mast": _radar((3.0, 0.0), (5.0, 0.8), 0.88, 12.0, 2500.0, **own)}
    more = {"interval_s": 2.0, "lag_s": 10.0, "detection_births.std": [8.0, 0.02]}
    return _scene(SEA, radars, flights, 180.0, more, platform=ship)


def stop_and_go(rng: Rng) -> Scene:
    """Eight cars on two streets brake, stand and drive on."""
    flights = []
    for k in range(8):
        speed, drives_s, stands_s = *rng.uniform([8.0, 7.0], [14.0, 12.0]), rng.uniform(6.0, 12.0)
        legs = [
            Leg(drives_s),
            Leg(speed / 3.0, 0.0, -3.0),
            Leg(stands_s),
            Leg(speed / 2.5, 0.0, 2.5),
            Leg(20.0),
        ]
        if k % 2:
            place, course = (rng.uniform(140.0, 185.0), 7.0 * (k - 4)), math.pi
        else:
            place, course = (25.0 + 7.0 * k, -rng.uniform(80.0, 95.0)), 0.5 * math.pi
        flights.append(_flight(place, speed, course, legs))
    return _scene(ROAD, _road_radar(8.0, 40.0), flights, 35.0, {})


SCENES: Mapping[str, Callable[[Rng], Scene]] = {
    "three unequal turns": unequal_turns,
    "asynchronous": asynchronous,
    "formations": formations,
    "hole": hole,
    "shallow crossings": shallow_crossings,
    "sensor off and on": off_and_on,
    "turns of 6 g": six_g,
    "flood of births": flood,
    "clutter by range": clutter_by_range,
    "folded range rates": folded_rates,
    "yawing radar": yawing,
    "stop and go": stop_and_go,
}
