"""Checks a scenario document as a whole and converts it to a `Scenario`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.configuration.schema import SMALL, ConfigError, Parameter, parameter
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, SensorBias
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel

from .antenna import Antenna, usual_antenna
from .checked import mapping, place, read_by_radar, take
from .clutter import echoes, law
from .clutter.mirrors import mirrors
from .clutter.reflectors import reflectors
from .platform import platform
from .scenario import Scenario
from .traffic import gaps, generators, targets
from .traffic.flight import Flight
from .traffic.geodesy import east_north
from .transponder import transponders

# Limit of a stamp's seconds, which are signed 32-bit integers.
END_OF_TIME_S = 2**31


@dataclass(frozen=True)
class Bias:
    """The biases of a radar; the block ``biases``."""

    range_bias: float = parameter(0.0, "Range bias: measured minus true range, m.", (-1e5, 1e5))
    range_gain: float = parameter(0.0, "Range scale error: bias per metre of range.", (-0.5, 0.5))
    azimuth_bias_deg: float = parameter(
        0.0, "Azimuth bias: measured minus true azimuth, clockwise, degrees.", (-180.0, 180.0)
    )
    time_offset_s: float = parameter(0.0, "Time bias: reported minus true time, s.", (-60.0, 60.0))

    @property
    def error(self) -> SensorBias:
        """The same biases with the azimuth counter-clockwise."""
        azimuth = -math.radians(self.azimuth_bias_deg)
        return SensorBias(self.range_bias, self.range_gain, azimuth, self.time_offset_s)


TIMING = (
    # The stamp 0 marks an unset time.
    Parameter("start_s", 1000.0, "Stamp of scan 0, s.", 1e-3, 4e9),
    Parameter("interval_s", 6.0, "Interval between scans, s.", SMALL, 1e6),
    Parameter("scans", 80, "Number of scans.", 1, 10**6),
    Parameter(
        "most_radars",
        0,
        "Largest number of turning radars that detect a target at a time, the nearest; 0 for all.",
        0,
        1000,
    ),
)
OTHER_KEYS = (
    "targets",
    "parameters",
    "traffic",
    "manoeuvres",
    "antennas",
    "biases",
    "clutter",
    "echoes",
    "world_origin",
    "sites",
    "reflectors",
    "platform",
    "transponders",
    "gaps",
    "mirrors",
    "sending",
)


def resolve(document: Any, radars: tuple[RadarModel, ...]) -> Scenario:
    """Check a scenario document and build its scenario.

    Parameters
    ----------
    document : mapping
        The keys of `TIMING`, all optional, and ``targets``, see `traffic.targets`. ``traffic`` and
        ``manoeuvres`` generate many targets, see `generators`. By name of the radar, ``antennas``
        has the keys of `Antenna`, ``biases`` the keys of `Bias`, ``clutter`` the law of the
        amplitudes, see `clutter.law`, and ``echoes`` further detections of targets, see `echoes`.
        ``world_origin`` is the latitude and longitude of the world's zero, and ``sites`` has the
        positions of radars by name, see `site_parameters`. ``reflectors`` is a list of mappings,
        see `reflectors`, and ``platform`` a ship that carries radars, with ``legs``.
        ``transponders`` describes targets' replies, see `transponder`, ``gaps`` times out of sight,
        see `gaps`, and ``mirrors`` surfaces that reflect replies, see `mirrors`. ``parameters`` (of
        the tracker and the radars), ``sites`` and ``sending`` (timing of messages) are ignored
        here.

    Raises
    ------
    ConfigError
        With all faults.
    """
    if not isinstance(document, Mapping):
        raise ConfigError(["scenario: must be a mapping"])
    faults: list[str] = []
    timing = take(TIMING, document, "", faults, OTHER_KEYS)
    every = targets.targets(document, faults)
    antennas = read_by_radar(Antenna, document, "antennas", radars, faults)
    biases = read_by_radar(Bias, document, "biases", radars, faults)
    clutter = law.laws(document, radars, faults)
    echo_laws = echoes.of_radars(document, radars, faults)
    carrier = platform(document, radars, faults)
    fixed = reflectors(document, radars, faults)
    replies = transponders(document, faults)
    reflecting = mirrors(document, faults)
    duration_s = 0.0 if faults else (timing["scans"] - 1) * timing["interval_s"]
    every += generators.traffic(mapping(document, "traffic", faults), duration_s, faults)
    given = mapping(document, "manoeuvres", faults)
    every += generators.manoeuvres(given, _origin(document, faults), duration_s, faults)
    interval_s = timing.get("interval_s") or 1.0
    flights = [t if isinstance(t, Flight) else t.flight(interval_s) for t in every]
    unseen = gaps.of_targets(document, flights, faults)
    faults = faults or _time_faults(timing)
    if faults:
        raise ConfigError(faults)
    return Scenario(
        start_ns=round(timing["start_s"] * 1e9),
        interval_s=timing["interval_s"],
        scans=timing["scans"],
        targets=tuple(every),
        radars=radars,
        antennas=tuple(each or usual_antenna(index) for index, each in enumerate(antennas)),
        most_radars=timing["most_radars"],
        clutter=clutter,
        echoes=echo_laws,
        reflectors=fixed,
        platform=carrier,
        transponders=replies,
        biases=tuple(each.error if each else NO_BIAS for each in biases) if any(biases) else (),
        gaps=unseen,
        mirrors=reflecting,
    )


def site_parameters(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters equivalent to ``world_origin`` and ``sites``, by dotted name.

    If the origin has a height, these are ``world_origin`` and each radar's ``geodetic``, on the
    round earth, which are not checked here; otherwise each radar's ``position``, in a plane.

    Raises
    ------
    ConfigError
        If a latitude or longitude is wrong.
    """
    faults: list[str] = []
    if _has_height(document):
        sites = mapping(document, "sites", faults)
        if faults:
            raise ConfigError(faults)
        found = {f"{name}.geodetic": given for name, given in sites.items()}
        return {"world_origin": document["world_origin"], **found}
    origin = _origin(document, faults)
    positions = {
        f"{name}.position": list(east_north(place(given, f"sites.{name}", faults), origin))
        for name, given in mapping(document, "sites", faults).items()
    }
    if faults:
        raise ConfigError(faults)
    return positions


def _origin(document: Mapping[str, Any], faults: list[str]) -> tuple[float, float]:
    given = document.get("world_origin", [0.0, 0.0])
    return place(given[:2] if _has_height(document) else given, "world_origin", faults)


def _has_height(document: Mapping[str, Any]) -> bool:
    """Return whether the world's origin has a height, so that the world is on the round earth."""
    origin = document.get("world_origin")
    return isinstance(origin, list) and len(origin) == 3


def _time_faults(timing: Mapping[str, Any]) -> list[str]:
    """Return the fault of the last scan's stamp, if it has one."""
    start, interval, scans = timing["start_s"], timing["interval_s"], timing["scans"]
    if start + (scans - 1) * interval < END_OF_TIME_S:
        return []
    return [
        f"start_s: {start} given, with {scans} scans {interval} s apart the last stamp must be "
        f"below {END_OF_TIME_S} s"
    ]
