"""The ASTERIX bridge's parameters, for the node and the offline tool, and their settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from msg_adapters import names
from phd_jdtc_ros.asterix.assembly import LEARNED
from phd_jdtc_ros.asterix.call_signs import CallSigns
from phd_jdtc_ros.asterix.clocks import StreamClock
from phd_jdtc_ros.asterix.columns import AMPLITUDES
from phd_jdtc_ros.asterix.plot_stream import MAX_RADARS, PlotStream, RadarSettings
from phd_jdtc_ros.asterix.transport import udp
from phd_jdtc_ros.asterix.writing.tracks import Source
from phd_jdtc_ros.calibration.tuning.rotation import PlotTurns
from phd_jdtc_ros.configuration.schema import ConfigError, Parameter, check, with_members
from phd_jdtc_ros.earth import SystemPlane

from .tracks import TrackOutput

# Upper bound of input addresses, each of which needs a socket and a buffer.
MOST_INPUTS = 64
# Parameters that apply to all radars and can be overridden under a radar's name.
OF_ANY_RADAR = (
    Parameter(
        "sectors",
        32,
        "Number of clouds to a turn, where the radar sends sector crossings; a multiple of 4, and "
        "no more than the radar's own sectors if clouds are to come as evenly as those.",
        4,
        256,
    ),
    Parameter(
        "rotation_s",
        0.0,
        "Time of a turn of the antenna, s, about; 0 to find it out. Without sector crossings a "
        "cloud is of an eighth of it.",
        0.0,
        60.0,
    ),
    Parameter(
        "hold_sectors",
        LEARNED,
        "Number of further sectors that a sector waits for late plots, where the radar sends "
        "sector crossings; late_plots in the diagnostics counts those that came later. -1: as many "
        "as they need.",
        LEARNED,
        32,
    ),
    Parameter(
        "amplitude",
        "any",
        "Where amplitudes are from. primary: PAM of I048/130; secondary: SAM; any: PAM if there "
        "is one, or else SAM.",
        choices=AMPLITUDES,
    ),
    Parameter(
        "amplitude_offset_db",
        100.0,
        "What is added to an amplitude in dBm to give the SNR in dB: the receiver's noise level "
        "with the opposite sign. The envelope is then sqrt(2 * 10^(SNR / 10)).",
        -200.0,
        300.0,
    ),
)
RADAR = (
    Parameter("sac", 0, "System area code of the radar.", 0, 255),
    Parameter("sic", 0, "System identification code of the radar.", 0, 255),
    Parameter(
        "geodetic",
        [],
        "Latitude and longitude (degrees, WGS84) and height (m) of its antenna, for the "
        "parameters that are written beside a bag; empty if they are not known, or if it says them "
        "(I034/120).",
    ),
    *OF_ANY_RADAR,
)
IN = (
    Parameter(
        "radars",
        [],
        "Names of the radars, each with its sac and sic; all others are left out. If empty every "
        "radar is taken, as radar_SAC_SIC.",
        element=str,
        most=MAX_RADARS,
    ),
    *OF_ANY_RADAR,
    Parameter(
        "max_clock_offset_s",
        10.0,
        "A radar whose times differ by more from those of their receipt has a wrong clock; its "
        "times are then shifted by the difference, s.",
        0.5,
        86400.0,
    ),
)
OUT = (
    Parameter(
        "output_period_s",
        1.0,
        "Time between outputs of all tracks, predicted to the time of output, s; 0 for one with "
        "each cloud of estimates.",
        0.0,
        60.0,
    ),
    Parameter("output_sac", 0, "System area code of the tracker.", 0, 255),
    Parameter("output_sic", 1, "System identification code of the tracker.", 0, 255),
    Parameter("output_service", 1, "Number of the service (I062/015).", 0, 255),
    Parameter(
        "world_origin",
        [],
        "Latitude (degrees), longitude (degrees) and height (m) of the map's zero, as the tracker "
        "has it; empty for tracks without latitudes and longitudes, whose heights are above the "
        "map's zero.",
    ),
    Parameter(
        "output_heights",
        "pressure",
        "What heights of tracks are. pressure: of the standard atmosphere, as flight levels are "
        "(I062/136 and 135); geometric: I062/130.",
        choices=("pressure", "geometric"),
    ),
    Parameter(
        "max_prediction_s",
        10.0,
        "Longest time for which estimates are predicted, s; without newer ones the tracks then "
        "end.",
        0.1,
        3600.0,
    ),
)
OF_FILES = (*IN, *OUT)
OF_NODE = (
    Parameter("autostart", True, "Configure and activate the node by itself at the start."),
    Parameter(
        "inputs",
        ["127.0.0.1:8600"],
        "What to receive: addresses of this machine or of multicast groups, with ports; empty for "
        "nothing.",
        element=str,
        most=MOST_INPUTS,
    ),
    Parameter(
        "interface",
        "",
        "Address of the network interface for multicast groups, in and out; empty for the "
        "system's choice.",
    ),
    Parameter(
        "replayed",
        False,
        "What comes is a recording that is played. Times of receipt are then not used: the first "
        "message is of 1970-01-01, as for a file without --date.",
    ),
    Parameter(
        "output", "", "Where to send tracks: an address or a group, with a port; empty for nowhere."
    ),
    Parameter("estimates_topic", names.estimates("filtered"), "Topic of the estimates to send."),
)
TABLE = (*OF_FILES, *OF_NODE)


@dataclass(frozen=True)
class Amplitudes:
    """The conversion of a radar's amplitudes; see `OF_ANY_RADAR`."""

    choice: str
    noise_dbm: float


@dataclass(frozen=True)
class Bridge:
    """The bridge's input as its parameters describe it.

    Parameters
    ----------
    values : dict of name to value
        All parameters.
    radars : dict of number to RadarSettings
        Configured radars by SAC and SIC.
    others : RadarSettings
        Settings of all other radars.
    """

    values: dict[str, Any]
    table: dict[str, Parameter]
    radars: dict[int, RadarSettings]
    others: RadarSettings

    def amplitudes(self, radar: str) -> Amplitudes:
        """Return the conversion of a radar's amplitudes."""
        own = f"{radar}." if f"{radar}.sac" in self.table else ""
        get = self.values
        return Amplitudes(get[f"{own}amplitude"], -get[f"{own}amplitude_offset_db"])

    def stream(self, clock: StreamClock) -> PlotStream:
        """Return the stream that processes the radars' datagrams."""
        return PlotStream(self.radars, self.others, clock, PlotTurns)


def output_of(bridge: Bridge, monosensor: bool, call_signs: CallSigns) -> TrackOutput:
    """Return the encoder of estimates; `call_signs` may grow with the radars' plots."""
    get = bridge.values
    origin = get["world_origin"]
    source = Source(
        get["output_sac"],
        get["output_sic"],
        get["output_service"],
        monosensor,
        get["output_heights"] == "geometric",
    )
    plane = SystemPlane(origin) if origin else None
    return TrackOutput(source, plane, get["max_prediction_s"], call_signs)


def resolve(given: Mapping[str, Any], top: tuple[Parameter, ...] = OF_FILES) -> Bridge:
    """Check parameters; a radar's missing parameters default to the common ones.

    Parameters
    ----------
    top : tuple of Parameter
        `OF_FILES`, or `TABLE` for the node.

    Raises
    ------
    ConfigError
        With all faults.
    """
    table = with_members(top, "radars", RADAR, given)
    values, faults = check(table.values(), given)
    if not faults:
        faults = [*_faults(values), *_address_faults(values)]
    if faults:
        raise ConfigError(faults)
    radars = {_number(values, name): _radar(values, name) for name in values["radars"]}
    return Bridge(values, table, radars, _radar(values, ""))


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
            sac, sic = values[f"{name}.sac"], values[f"{name}.sic"]
            faults.append(f"{name}.sic: {sac}/{sic} given, is that of {other} too")
        faults += _place_faults(f"{name}.geodetic", values[f"{name}.geodetic"])
    return faults + _place_faults("world_origin", values["world_origin"])


def _address_faults(values: Mapping[str, Any]) -> list[str]:
    """Return the faults of a node's addresses."""
    faults = []
    output = values.get("output", "")
    for name, given in (
        *(("inputs", text) for text in values.get("inputs", [])),
        *([("output", output)] if output else []),
    ):
        try:
            udp.address(given)
        except ValueError as error:
            faults.append(f"{name}: {error}")
    interface = values.get("interface", "")
    if interface:
        try:
            udp.address(f"{interface}:1")
        except ValueError:
            faults.append(f"interface: {interface} given, must be an IPv4 address")
    return faults


def _place_faults(name: str, place: list[float]) -> list[str]:
    if not place:
        return []
    try:
        SystemPlane(place)
    except ValueError as error:
        return [f"{name}{str(error).removeprefix('origin')}"]
    return []


def _number(values: Mapping[str, Any], name: str) -> int:
    return int(values[f"{name}.sac"]) << 8 | int(values[f"{name}.sic"])


def _radar(values: Mapping[str, Any], name: str) -> RadarSettings:
    own = f"{name}." if name else ""
    return RadarSettings(
        name,
        values[f"{own}sectors"],
        values[f"{own}rotation_s"],
        values[f"{own}hold_sectors"],
        tuple(values[f"{own}geodetic"]) if name and values[f"{own}geodetic"] else None,
    )


def topic_of(radar: str) -> str:
    """Return the topic of a radar's clouds."""
    return names.detections(radar)
