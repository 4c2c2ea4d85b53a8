"""The parameters of the ASTERIX bridge, and the stream of plots that they describe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from phd_jdtc_ros.asterix.assembly import LEARNED
from phd_jdtc_ros.asterix.clocks import StreamClock
from phd_jdtc_ros.asterix.plot_stream import MAX_RADARS, PlotStream, RadarSettings
from phd_jdtc_ros.calibration.tuning.plots import PlotRevolutions
from phd_jdtc_ros.configuration.parameters import replaced
from phd_jdtc_ros.configuration.parameters.place_forms import PLACE
from phd_jdtc_ros.configuration.schema import (
    ConfigError,
    Parameter,
    check,
    parameter,
    shared,
    table,
    with_members,
)
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files.node_tables import Managed, Receiving
from phd_jdtc_ros.transport import sockets


@dataclass(frozen=True)
class RadarDefaults:
    """Parameters that apply to all radars and can be overridden under a radar's name."""

    sectors: int = parameter(
        32,
        "Number of clouds per revolution, a multiple of 4, for a radar with sector crossings; "
        "without, a cloud covers an eighth of a revolution. For clouds at even intervals set at "
        "most the radar's own number of sectors.",
        (4, 256),
    )
    hold_sectors: int = parameter(
        LEARNED,
        "Number of further sectors for which a sector waits for late plots, for a radar with "
        "sector crossings; -1 to learn it. Set 0 for a radar that sends its plots before the "
        "crossing.",
        (LEARNED, 32),
    )


@dataclass(frozen=True)
class RadarParameters(RadarDefaults):
    """Parameters of each radar."""

    source: list[float] = parameter(
        [0, 0],
        "System area and identification code (SAC and SIC) of the radar.",
        (0, 255),
        length=2,
    )
    geodetic: list[float] = parameter(
        [],
        "Latitude and longitude (WGS84, degrees) and height (m) of the antenna, for the "
        "parameters beside a bag. Empty if the radar reports them (I034/120) or they are "
        "unknown.",
        form=PLACE,
    )


@dataclass(frozen=True)
class InputParameters(RadarDefaults):
    """Parameters of incoming plots."""

    radars: list[str] = parameter(
        [],
        "Names of the radars, each with its source; plots of other radars are dropped. Empty for "
        "every radar, named radar_SAC_SIC.",
        element=str,
        most=MAX_RADARS,
    )
    max_clock_offset_s: float = shared(Receiving, "max_clock_offset_s")


@dataclass(frozen=True)
class OutputParameters:
    """Parameters of outgoing tracks."""

    output_period_s: float = parameter(
        1.0,
        "Period of track output, s, with all tracks predicted to the time of output; 0 for "
        "output with each cloud of estimates.",
        (0.0, 60.0),
    )
    output_source: list[float] = parameter(
        [0, 1, 1],
        "System area and identification code of the tracker, and number of the service (I062/015).",
        (0, 255),
        length=3,
    )
    world_origin: list[float] = parameter(
        [],
        "Latitude and longitude (degrees) and height (m) of the map's origin, as in the tracker. "
        "Empty for tracks without latitudes and longitudes.",
        form=PLACE,
    )
    output_heights: str = parameter(
        "pressure",
        "Kind of the tracks' heights: pressure, as flight levels (I062/136 and 135), or "
        "geometric (I062/130).",
        choices=("pressure", "geometric"),
    )


@dataclass(frozen=True)
class NodeParameters(Managed):
    """Parameters of the node only."""

    inputs: list[str] = parameter(
        ["127.0.0.1:8600"],
        "Addresses to receive from, HOST:PORT of this machine or of multicast groups; empty for "
        "none.",
        element=str,
        # Largest number of input addresses, each of which needs a socket and a buffer.
        most=64,
    )
    interface: str = shared(Receiving, "interface")
    replayed: bool = shared(Receiving, "replayed")
    output: str = parameter(
        "", "Address to send tracks to, HOST:PORT of a host or a group; empty for none."
    )


RADAR = table(RadarParameters)
OF_FILES = (*table(InputParameters), *table(OutputParameters))
TABLE = (*OF_FILES, *table(NodeParameters))


@dataclass(frozen=True)
class Bridge:
    """The configuration of a bridge."""

    values: dict[str, Any]  # All parameters
    table: dict[str, Parameter]
    radars: dict[int, RadarSettings]  # Configured radars by SAC and SIC
    others: RadarSettings  # Settings of all other radars

    def stream(self, clock: StreamClock) -> PlotStream:
        """Return the stream that processes the radars' datagrams."""
        return PlotStream(self.radars, self.others, clock, PlotRevolutions, locate)


def locate(site: tuple[float, float, float], x: float, y: float) -> tuple[float, float]:
    """Return latitude and longitude of a point in the plane of a place, degrees."""
    latitude, longitude = _plane(site).to_geodetic(x, y)
    return float(latitude), float(longitude)


@lru_cache(maxsize=MAX_RADARS)
def _plane(site: tuple[float, float, float]) -> SystemPlane:
    return SystemPlane(list(site))


def resolve(given: Mapping[str, Any], top: tuple[Parameter, ...] = OF_FILES) -> Bridge:
    """Return the bridge that parameters describe; `ConfigError` has all faults.

    `top` has the parameters that are not of a single radar: `TABLE` for the node. A radar's missing
    parameters default to those.
    """
    parameters = with_members(top, "radars", RADAR, given)
    values, faults = check(parameters.values(), given, replaced.BRIDGE, replaced.BRIDGE_RADAR)
    if not faults:
        faults = [*_faults(values), *_address_faults(values)]
    if faults:
        raise ConfigError(*faults)
    radars = {_number(values, name): _radar(values, name) for name in values["radars"]}
    return Bridge(values, parameters, radars, _radar(values, ""))


def _faults(values: Mapping[str, Any]) -> list[str]:
    faults = []
    for name in ("", *(f"{radar}." for radar in values["radars"])):
        sectors = values[f"{name}sectors"]
        if sectors % 4:
            faults.append(f"{name}sectors: {sectors} given, must be a multiple of 4")
    numbers: dict[int, str] = {}
    for name in values["radars"]:
        other = numbers.setdefault(_number(values, name), name)
        if other != name:
            sac, sic = map(int, values[f"{name}.source"])
            faults.append(f"{name}.source: {sac}/{sic} given, {other} has it too")
    return faults


def _address_faults(values: Mapping[str, Any]) -> list[str]:
    faults = []
    given = [("inputs", text) for text in values.get("inputs", [])]
    given += [("output", text) for text in [values.get("output")] if text]
    for name, text in given:
        try:
            sockets.address(text)
        except ValueError as error:
            faults.append(f"{name}: {error}")
    return [*faults, *sockets.interface_faults(values.get("interface", ""))]


def _number(values: Mapping[str, Any], name: str) -> int:
    sac, sic = map(int, values[f"{name}.source"])
    return sac << 8 | sic


def _radar(values: Mapping[str, Any], name: str) -> RadarSettings:
    own = f"{name}." if name else ""
    return RadarSettings(
        name,
        values[f"{own}sectors"],
        values[f"{own}hold_sectors"],
        tuple(values[f"{own}geodetic"]) if name and values[f"{own}geodetic"] else None,
    )
