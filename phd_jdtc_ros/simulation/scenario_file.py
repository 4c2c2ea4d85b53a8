"""Checks a scenario document as a whole and converts it to a `Scenario`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from phd_jdtc_ros.configuration.schema import SMALL, ConfigError, Parameter
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, SensorBias
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel

from .antenna import Antenna, usual_antenna
from .checked import mapping, names_of, place, take, values_by_radar
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
ANTENNA = (
    Parameter(
        "bearing_deg",
        0.0,
        "Direction at scan 0: angle from the radar's y axis in the sense of rotation, degrees.",
        0.0,
        360.0,
    ),
    Parameter("clockwise", True, "Whether the antenna turns clockwise."),
    Parameter(
        "wobble", 0.0, "Largest relative deviation of the rotation rate from its mean.", 0.0, 0.5
    ),
    Parameter("wobble_period_s", 600.0, "Period of this deviation, s.", SMALL, 1e6),
    Parameter("lowest_deg", -90.0, "Lowest elevation of the beam, degrees.", -90.0, 90.0),
    Parameter("highest_deg", 90.0, "Highest elevation of the beam, degrees.", -90.0, 90.0),
)
BIAS = (
    Parameter("range_bias", 0.0, "Range bias: measured minus true range, m.", -1e5, 1e5),
    Parameter("range_gain", 0.0, "Range scale error: bias per metre of range.", -0.5, 0.5),
    Parameter(
        "azimuth_bias_deg",
        0.0,
        "Azimuth bias: measured minus true azimuth, clockwise, degrees.",
        -180.0,
        180.0,
    ),
    Parameter("time_offset_s", 0.0, "Time bias: reported minus true time, s.", -60.0, 60.0),
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
        has the keys of `ANTENNA`, ``biases`` the keys of `BIAS`, ``clutter`` the law of the
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
    timing = take(TIMING, document, "", faults, names_of(TIMING), OTHER_KEYS)
    every = targets.targets(document, faults)
    antennas = _antennas(document, radars, faults)
    biases = _biases(document, radars, faults)
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
        antennas=antennas,
        most_radars=timing["most_radars"],
        clutter=clutter,
        echoes=echo_laws,
        reflectors=fixed,
        platform=carrier,
        transponders=replies,
        biases=biases,
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


def _antennas(
    document: Mapping[str, Any], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[Antenna, ...]:
    """Return every radar's antenna, by default the usual one; add faults to `faults`."""
    every = values_by_radar(ANTENNA, document, "antennas", radars, faults)
    return tuple(
        usual_antenna(index)
        if values is None
        else Antenna(
            math.radians(values["bearing_deg"]),
            values["clockwise"],
            values["wobble"],
            values["wobble_period_s"],
            math.radians(values["lowest_deg"]),
            math.radians(values["highest_deg"]),
        )
        for index, values in enumerate(every)
    )


def _biases(
    document: Mapping[str, Any], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[SensorBias, ...]:
    """Return every radar's biases; empty if none are given; add faults to `faults`."""
    every = values_by_radar(BIAS, document, "biases", radars, faults)
    biases = tuple(
        NO_BIAS
        if values is None
        else SensorBias(
            values["range_bias"],
            values["range_gain"],
            -math.radians(values["azimuth_bias_deg"]),
            values["time_offset_s"],
        )
        for values in every
    )
    return biases if any(every) else ()


def _time_faults(timing: Mapping[str, Any]) -> list[str]:
    """Return the fault of the last scan's stamp, if it has one."""
    start, interval, scans = timing["start_s"], timing["interval_s"], timing["scans"]
    if start + (scans - 1) * interval < END_OF_TIME_S:
        return []
    return [
        f"start_s: {start} given, with {scans} scans {interval} s apart the last stamp must be "
        f"below {END_OF_TIME_S} s"
    ]
