"""Checks a scenario document as a whole and converts it to a `Scenario`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from phd_jdtc_ros.configuration.schema import SMALL, ConfigError, Parameter
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, RadarBias
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel
from phd_jdtc_ros.core.targets.amplitude_density import snr_from_db

from .antenna import Antenna, usual_antenna
from .checked import mapping, mappings, names_of, place, take
from .clutter import echoes, law
from .clutter.mirrors import mirrors
from .clutter.reflectors import reflectors
from .platform import platform
from .scenario import Scenario, Target, TargetScript, Turn
from .traffic import gaps, generators
from .traffic.flight import Flight, Leg
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
HEIGHT = Parameter("height", 0.0, "Height above the world's zero, m.", -1e4, 3e4)
TARGET = (
    Parameter("class_id", 0, "Class, from 0.", 0, 1000),
    Parameter("snr_db", 30.0, "Mean signal-to-noise ratio, dB.", -100.0, 200.0),
    Parameter("position", [0.0, 0.0], "Position at the first scan, world frame, m.", length=2),
    Parameter("velocity", [0.0, 0.0], "Velocity at the first scan, world frame, m/s.", length=2),
    Parameter("first_scan", 0, "First scan in which the target exists.", 0, 10**6),
    Parameter("last_scan", 0, "Last scan in which the target exists.", 0, 10**6),
    HEIGHT,
)
FLIGHT = (
    Parameter("class_id", 0, "Class, from 0.", 0, 1000),
    generators.SNR,
    Parameter("start_s", 0.0, "Time of appearance, s after scan 0.", 0.0, 1e7),
    Parameter("position", [0.0, 0.0], "Position at the start, world frame, m.", length=2),
    Parameter("velocity", [0.0, 0.0], "Velocity at the start, world frame, m/s.", length=2),
    HEIGHT,
)
LEG = (
    Parameter("duration_s", 0.0, "Length of the leg, s.", SMALL, 1e7),
    Parameter(
        "turn_rate_deg_s", 0.0, "Turn rate, counter-clockwise, degrees per second.", -180.0, 180.0
    ),
    Parameter("acceleration", 0.0, "Change of the speed, m/s^2.", -1e3, 1e3),
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
TURN = (
    Parameter("first_scan", 0, "Scan at which the turn begins.", 0, 10**6),
    Parameter("last_scan", 0, "Scan at which the turn ends.", 0, 10**6),
    Parameter(
        "turn_rate_deg_s", 0.0, "Turn rate, counter-clockwise, degrees per second.", -180.0, 180.0
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
        The keys of `TIMING`, all optional, and ``targets``: a list of mappings with all keys of
        `TARGET`. A target may have ``turns``: a list of mappings with all keys of `TURN`. A target
        with ``legs``, a list of mappings of `LEG`, has the keys of `FLIGHT` instead. ``traffic``
        and ``manoeuvres`` generate many targets, see `generators`. By name of the radar,
        ``antennas`` has the keys of `ANTENNA`, ``biases`` the keys of `BIAS`, ``clutter`` the law
        of the amplitudes, see `clutter.law`, and ``echoes`` further detections of targets, see
        `echoes`. ``world_origin`` is the latitude and longitude of the world's zero, and ``sites``
        has the positions of radars by name, see `site_parameters`. ``reflectors`` is a list of
        mappings, see `reflectors`, and ``platform`` a ship that carries radars, with ``legs``.
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
    targets = _targets(document, faults)
    antennas = _antennas(mapping(document, "antennas", faults), radars, faults)
    biases = _biases(mapping(document, "biases", faults), radars, faults)
    clutter = law.laws(document, radars, faults)
    answers = echoes.of_radars(document, radars, faults)
    carrier = platform(document, radars, _legs, faults)
    still = reflectors(document, radars, faults)
    replies = transponders(document, faults)
    reflecting = mirrors(document, faults)
    duration_s = 0.0 if faults else (timing["scans"] - 1) * timing["interval_s"]
    targets += generators.traffic(mapping(document, "traffic", faults), duration_s, faults)
    given = mapping(document, "manoeuvres", faults)
    targets += generators.manoeuvres(given, _origin(document, faults), duration_s, faults)
    interval_s = timing.get("interval_s") or 1.0
    flights = [t if isinstance(t, Flight) else t.flight(interval_s) for t in targets]
    unseen = gaps.of_targets(document, flights, faults)
    faults = faults or _time_faults(timing)
    if faults:
        raise ConfigError(faults)
    return Scenario(
        start_ns=round(timing["start_s"] * 1e9),
        interval_s=timing["interval_s"],
        scans=timing["scans"],
        targets=tuple(targets),
        radars=radars,
        antennas=antennas,
        most_radars=timing["most_radars"],
        clutter=clutter,
        echoes=answers,
        reflectors=still,
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
    given: Mapping[str, Any], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[Antenna, ...]:
    """Return every radar's antenna, by default the usual one; add faults to `faults`."""
    known = [radar.name for radar in radars]
    faults += [
        f"antennas.{name}: must be one of the radars, {', '.join(known)}"
        for name in given
        if name not in known
    ]
    antennas = []
    for index, name in enumerate(known):
        of_radar = mapping(given, name, faults)
        if not of_radar:
            antennas.append(usual_antenna(index))
            continue
        found: list[str] = []
        values = take(ANTENNA, of_radar, f"antennas.{name}.", found, names_of(ANTENNA))
        faults += found
        if not found:
            antennas.append(
                Antenna(
                    math.radians(values["bearing_deg"]),
                    values["clockwise"],
                    values["wobble"],
                    values["wobble_period_s"],
                    math.radians(values["lowest_deg"]),
                    math.radians(values["highest_deg"]),
                )
            )
    return tuple(antennas)


def _biases(
    given: Mapping[str, Any], radars: tuple[RadarModel, ...], faults: list[str]
) -> tuple[RadarBias, ...]:
    """Return every radar's biases; empty if none are given; add faults to `faults`."""
    known = [radar.name for radar in radars]
    faults += [
        f"biases.{name}: must be one of the radars, {', '.join(known)}"
        for name in given
        if name not in known
    ]
    if not given:
        return ()
    biases = []
    for name in known:
        found: list[str] = []
        of_radar = mapping(given, name, found)
        values = take(BIAS, of_radar, f"biases.{name}.", found, names_of(BIAS))
        faults += found
        biases.append(NO_BIAS if found else _bias(values))
    return tuple(biases)


def _bias(values: Mapping[str, Any]) -> RadarBias:
    return RadarBias(
        values["range_bias"],
        values["range_gain"],
        -math.radians(values["azimuth_bias_deg"]),
        values["time_offset_s"],
    )


def _targets(document: Mapping[str, Any], faults: list[str]) -> list[Target]:
    """Return the checked targets; add faults to `faults`."""
    targets = [
        (_flight if "legs" in script else _target)(script, f"targets[{index}].", faults)
        for index, script in enumerate(mappings(document, "targets", "", faults))
    ]
    return [target for target in targets if target is not None]


def _flight(script: Mapping[str, Any], prefix: str, faults: list[str]) -> Flight | None:
    """Return a checked flight; add its faults to `faults` and return None if there are any."""
    found: list[str] = []
    values = take(FLIGHT, script, prefix, found, ("snr_db", "start_s", "height"), ("legs",))
    legs = _legs(script, prefix, found)
    if not found:
        try:
            return Flight(
                class_id=values["class_id"],
                snr=snr_from_db(values["snr_db"]),
                start_s=values["start_s"],
                position=tuple(values["position"]),
                velocity=tuple(values["velocity"]),
                legs=legs,
                height=values["height"],
            )
        except ValueError as error:
            found.append(f"{prefix}{error}")
    faults += found
    return None


def _legs(script: Mapping[str, Any], prefix: str, faults: list[str]) -> tuple[Leg, ...]:
    """Return the checked legs of a block; add faults to `faults` and then return none."""
    found: list[str] = []
    legs = []
    for index, given in enumerate(mappings(script, "legs", prefix, found)):
        name = f"{prefix}legs[{index}]."
        leg = take(LEG, given, name, found, ("turn_rate_deg_s", "acceleration"))
        if leg.get("turn_rate_deg_s") and leg.get("acceleration"):
            found.append(f"{name}acceleration: {leg['acceleration']} given, must be 0 in a turn")
        legs.append(leg)
    if not legs and not found:
        found.append(f"{prefix}legs: none given, must be at least one")
    faults += found
    if found:
        return ()
    return tuple(
        Leg(leg["duration_s"], math.radians(leg["turn_rate_deg_s"]), leg["acceleration"])
        for leg in legs
    )


def _target(script: Mapping[str, Any], prefix: str, faults: list[str]) -> TargetScript | None:
    """Return a checked target; add its faults to `faults` and return None if there are any."""
    found: list[str] = []
    target = take(TARGET, script, prefix, found, ("height",), ("turns",))
    turns = [
        take(TURN, turn, f"{prefix}turns[{index}].", found)
        for index, turn in enumerate(mappings(script, "turns", prefix, found))
    ]
    found = found or _order_faults(target, turns, prefix)
    faults += found
    if found:
        return None
    return TargetScript(
        class_id=target["class_id"],
        snr=snr_from_db(target["snr_db"]),
        position=tuple(target["position"]),
        velocity=tuple(target["velocity"]),
        first_scan=target["first_scan"],
        last_scan=target["last_scan"],
        turns=tuple(
            Turn(turn["first_scan"], turn["last_scan"], math.radians(turn["turn_rate_deg_s"]))
            for turn in turns
        ),
        height=target["height"],
    )


def _order_faults(
    target: Mapping[str, Any], turns: Sequence[Mapping[str, Any]], prefix: str
) -> list[str]:
    """Return the faults in the order of a target's scans."""
    first, last = target["first_scan"], target["last_scan"]
    if last < first:
        return [f"{prefix}last_scan: {last} given, must be at least first_scan, {first}"]
    faults = []
    earliest = first
    for index, turn in enumerate(turns):
        begin, end = turn["first_scan"], turn["last_scan"]
        name = f"{prefix}turns[{index}]"
        if begin < earliest:
            event = "previous turn ends" if index else "target appears"
            faults.append(
                f"{name}.first_scan: {begin} given, must be at least {earliest}, when the {event}"
            )
        if not begin < end <= last:
            faults.append(
                f"{name}.last_scan: {end} given, must be above its first_scan, {begin}, and at "
                f"most the target's last_scan, {last}"
            )
        earliest = end
    return faults


def _time_faults(timing: Mapping[str, Any]) -> list[str]:
    """Return the fault of the last scan's stamp, if it has one."""
    start, interval, scans = timing["start_s"], timing["interval_s"], timing["scans"]
    if start + (scans - 1) * interval < END_OF_TIME_S:
        return []
    return [
        f"start_s: {start} given, with {scans} scans {interval} s apart the last stamp must be "
        f"below {END_OF_TIME_S} s"
    ]
