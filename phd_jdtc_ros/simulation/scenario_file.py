"""Checks a scenario document as a whole and converts it to a `Scenario`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.configuration.schema import SMALL, ConfigError, parameter
from phd_jdtc_ros.core.sensors.bias import NO_BIAS, SensorBias
from phd_jdtc_ros.core.sensors.polar_radar import RadarModel

from . import clutter, targets, traffic
from .antenna import Antenna, default_antenna
from .checked import mapping, place, read, read_by_radar, read_list
from .clutter import Mirror, reflectors
from .scenario import Scenario, platform
from .targets import Flight, east_north
from .transponder import transponders


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


@dataclass(frozen=True)
class Timing:
    """The keys of a document that are not blocks."""

    # Limit of a stamp's seconds, which are signed 32-bit integers.
    END_OF_TIME_S = 2**31

    # The stamp 0 marks an unset time.
    start_s: float = parameter(1000.0, "Stamp of scan 0, s.", (1e-3, 4e9))
    interval_s: float = parameter(6.0, "Interval between scans, s.", (SMALL, 1e6))
    scans: int = parameter(80, "Number of scans.", (1, 10**6))
    most_radars: int = parameter(
        0,
        "Largest number of turning radars that detect a target at a time, the nearest; 0 for all.",
        (0, 1000),
    )

    def __post_init__(self) -> None:
        if self.start_s + self.duration_s >= self.END_OF_TIME_S:
            raise ConfigError(
                f"start_s: {self.start_s} given, with {self.scans} scans {self.interval_s} s "
                f"apart the last stamp must be below {self.END_OF_TIME_S} s"
            )

    @property
    def duration_s(self) -> float:
        """Time from the first to the last scan, seconds."""
        return (self.scans - 1) * self.interval_s


def resolve(document: Any, radars: tuple[RadarModel, ...]) -> Scenario:
    """Build the scenario of a document; `ConfigError` has all faults."""
    # The blocks, which their modules describe; ``profile`` and ``parameters`` (of the tracker and
    # the radars), ``sites`` and ``sending`` are read elsewhere.
    blocks = (
        *("profile", "parameters", "targets", "traffic", "manoeuvres", "antennas", "biases"),
        *("clutter", "echoes", "world_origin", "sites", "reflectors", "platform", "transponders"),
        *("gaps", "mirrors", "sending", "self_reports"),
    )
    if not isinstance(document, Mapping):
        raise ConfigError("scenario: must be a mapping")
    faults: list[str] = []
    timing = read(Timing, document, "", faults, blocks)
    all_targets = targets.targets(document, faults)
    antennas = read_by_radar(Antenna, document, "antennas", radars, faults)
    biases = read_by_radar(Bias, document, "biases", radars, faults)
    false_detections = clutter.read_clutter(document, radars, faults)
    echo_laws = clutter.read_echoes(document, radars, faults)
    carrier = platform(document, radars, faults)
    fixed = reflectors(document, radars, faults)
    replies = transponders(document, faults)
    reflecting = read_list(Mirror, document, "mirrors", "", faults)
    duration_s = 0.0 if timing is None or faults else timing.duration_s
    all_targets += traffic.traffic(mapping(document, "traffic", faults), duration_s, faults)
    given = mapping(document, "manoeuvres", faults)
    all_targets += traffic.manoeuvres(given, _origin(document, faults), duration_s, faults)
    interval_s = timing.interval_s if timing else 1.0
    flights = [t if isinstance(t, Flight) else t.flight(interval_s) for t in all_targets]
    unseen = targets.read_gaps(document, flights, faults)
    if timing is None or faults:
        raise ConfigError(*faults)
    return Scenario(
        start_ns=round(timing.start_s * 1e9),
        interval_s=timing.interval_s,
        scans=timing.scans,
        targets=tuple(all_targets),
        radars=radars,
        antennas=tuple(each or default_antenna(index) for index, each in enumerate(antennas)),
        most_radars=timing.most_radars,
        clutter=false_detections,
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
    round earth, which are not checked here; otherwise each radar's ``position``, in a plane. Raise
    `ConfigError` if a latitude or longitude is wrong.
    """
    faults: list[str] = []
    if _has_height(document):
        sites = mapping(document, "sites", faults)
        if faults:
            raise ConfigError(*faults)
        found = {f"{name}.geodetic": given for name, given in sites.items()}
        return {"world_origin": document["world_origin"], **found}
    origin = _origin(document, faults)
    positions = {
        f"{name}.position": list(east_north(place(given, f"sites.{name}", faults), origin))
        for name, given in mapping(document, "sites", faults).items()
    }
    if faults:
        raise ConfigError(*faults)
    return positions


def _origin(document: Mapping[str, Any], faults: list[str]) -> tuple[float, float]:
    given = document.get("world_origin", [0.0, 0.0])
    return place(given[:2] if _has_height(document) else given, "world_origin", faults)


def _has_height(document: Mapping[str, Any]) -> bool:
    """Return whether the world's origin has a height, so that the world is on the round earth."""
    origin = document.get("world_origin")
    return isinstance(origin, list) and len(origin) == 3
