"""The ASTERIX bridge, for its node and its offline tool: parameters, plots as clouds, tracks out.

The tracker's estimates are sent as ASTERIX, predicted to the time of output.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import RejectedMessageError, names, point_cloud
from msg_adapters.targets import estimates
from phd_jdtc_ros.asterix import writing as tracks_out
from phd_jdtc_ros.asterix.assembly import LEARNED, SectorReport
from phd_jdtc_ros.asterix.clocks import StreamClock
from phd_jdtc_ros.asterix.messages import ADS_B, NONE, CallSigns, Plot, call_sign_of
from phd_jdtc_ros.asterix.plot_stream import (
    MAX_RADARS,
    Cloud,
    PlotStream,
    RadarSettings,
    RadarState,
)
from phd_jdtc_ros.asterix.writing import Source, TrackReport
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
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.targets.modes import ModeSpace
from phd_jdtc_ros.core.targets.motion import CoordinatedTurn
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, Estimates, Reported
from phd_jdtc_ros.core.types.reports import ICAO, text_of
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files.node_tables import Managed, Receiving
from phd_jdtc_ros.transponders import stream
from phd_jdtc_ros.transponders.stream import Batch
from phd_jdtc_ros.transport import sockets

# Level of a receiver's noise that amplitudes are converted with, dBm. The tracker's parameter
# `amplitude_offset_db` corrects it for a radar.
NOISE_DBM = -100.0
# Marks an unknown code or address in a cloud.
UNKNOWN = 2**32 - 1


def columns(report: SectorReport, sectors: int) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a cloud in their order, arrays of shape (M,).

    `sectors` is the number of sectors per revolution, a multiple of 4. An amplitude of s dBm, of
    the echo or else of the replies, becomes an envelope of ``sqrt(2 * 10^((s - NOISE_DBM) / 10))``
    in units of the noise's standard deviation per quadrature component.

    The columns are ``x y z`` in the frame of the radar, whose x axis is east; ``range`` (slant, m),
    ``azimuth`` (rad counter-clockwise from the x axis), ``elevation`` (0), ``amplitude`` (NaN if
    unknown), ``time`` (s relative to the stamp), ``height`` (m, NaN if unknown), ``code`` and
    ``address`` (`UNKNOWN` if unknown), and ``kind`` (the TYP of I048/020). If any call sign is
    known, ``call_sign_high`` and ``call_sign_low`` follow, 24 bits each (`UNKNOWN` if unknown). If
    the sector is known, ``sector`` follows, counted counter-clockwise from the x axis like
    azimuths.
    """
    plots = report.plots
    fields = dict(zip(Plot._fields, zip(*plots, strict=True), strict=True)) if plots else {}

    def column(name: str) -> npt.NDArray[np.float64]:
        return np.array(fields.get(name, ()), dtype=np.float64)

    distance, compass = column("distance"), column("azimuth")
    azimuth = math.pi - np.remainder(compass + 0.5 * math.pi, 2.0 * math.pi)
    zero = np.zeros(len(plots))
    echoes, replies = column("primary_dbm"), column("secondary_dbm")
    times = np.array([time - report.stamp_ns for time in report.times_ns], dtype=np.float64)
    found: dict[str, npt.NDArray[Any]] = {
        "x": distance * np.cos(azimuth),
        "y": distance * np.sin(azimuth),
        "z": zero,
        "range": distance,
        "azimuth": azimuth,
        "elevation": zero,
        "amplitude": _amplitude(np.where(np.isnan(echoes), replies, echoes)),
        "time": times * 1e-9,
        "height": column("height"),
        "code": _identity(column("code")),
        "address": _identity(column("address")),
        "kind": column("detection_type").astype(np.uint8),
    }
    signs = np.array(fields.get("call_sign", ()), dtype=np.int64)
    if (signs != NONE).any():
        found["call_sign_high"] = np.where(signs == NONE, UNKNOWN, signs >> 24).astype(np.uint32)
        low = np.where(signs == NONE, UNKNOWN, signs & 0xFFFFFF)
        found["call_sign_low"] = low.astype(np.uint32)
    if report.sector is not None:
        own = (sectors // 4 - 1 - report.sector) % sectors
        found["sector"] = np.full(len(plots), own, dtype=np.uint32)
    return found


def _amplitude(level_dbm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    envelope: npt.NDArray[np.float64] = np.sqrt(2.0 * 10.0 ** ((level_dbm - NOISE_DBM) / 10.0))
    return envelope


def _identity(given: npt.NDArray[np.float64]) -> npt.NDArray[np.uint32]:
    return np.where(given == NONE, UNKNOWN, given).astype(np.uint32)


def topic_of(report: Cloud, radar: RadarState) -> str:
    """Return the topic of a cloud: that of a radar's detections, or of reports."""
    name = radar.settings.name
    return names.reports(name) if isinstance(report, Batch) else names.detections(name)


def cloud(report: Cloud, radar: RadarState) -> PointCloud2:
    """Return the cloud of a sector, a slice or a batch, in the frame with the radar's name.

    Those of positions are `stream.columns`, with ellipses unless they are from ADS-B.

    The fields are those of `columns`. All are FLOAT32, except for ``code address call_sign_high
    call_sign_low sector`` (UINT32) and ``kind`` (UINT8). All clouds of a radar with sectors have
    that field; in a slice it is `UNKNOWN`.
    """
    settings = radar.settings
    if isinstance(report, Batch):
        positions = stream.columns(report, radar.source != ADS_B)
        return point_cloud.encode(report.stamp_ns, settings.name, positions, stream.WIDE)
    found = columns(report, settings.sectors)
    if radar.assembler.has_sectors and report.sector is None:
        found["sector"] = np.full(len(report.plots), UNKNOWN, dtype=np.uint32)
    return point_cloud.encode(report.stamp_ns, settings.name, found)


# Smaller turn rates (rad/s) and climb rates (m/s, 300 ft/min) count as straight and level. A turn
# must also exceed TURN_DEVIATIONS standard deviations.
LEAST_TURN, LEAST_CLIMB, TURN_DEVIATIONS = math.radians(0.5), 1.5, 2.0


@dataclass
class _Life:
    """The times at which a track was first reported and last detected."""

    first_ns: int
    seen_ns: int


class TrackOutput:
    """Converts clouds of estimates to data blocks.

    Without a plane there are no latitudes and longitudes, and heights are above the world's zero.
    Tracks end when their latest estimates are older than `max_prediction_s`.
    """

    # Owner probability from which a source is a track's, and from which a track is silent.
    OWNED = 0.5
    # Largest number of tracks sent at once, each of which is a message.
    MOST_TRACKS = 10_000
    # Motion model for the prediction to the time of output; covariances are predicted to first
    # order, with the process noise of the tracker's own modes.
    _TURN = CoordinatedTurn(0.0, 0.0)

    def __init__(
        self,
        source: Source,
        plane: Plane | None,
        max_prediction_s: float,
        call_signs: CallSigns,
    ) -> None:
        self.source = source
        self._call_signs = call_signs
        self._plane = plane
        self.modes: ModeSpace | None = None  # Those of the tracker, if they are known
        # Estimates have heights above the map's zero, which may differ from the zero of flight
        # levels.
        self._datum = 0.0 if plane is None else plane.origin[2]
        self._max_prediction_s = max_prediction_s
        self._found: Estimates | None = None
        self.stamp_ns = 0  # Stamp of the current estimates
        self._lives: dict[int, _Life] = {}
        self._reported: dict[int, TrackReport] = {}
        self.batch = 0  # Number of outputs so far
        self.tracks = 0  # Number of tracks sent so far

    def update(self, cloud: PointCloud2) -> None:
        """Replace the current estimates by those of a cloud, or raise `RejectedMessageError`."""
        if cloud.width * cloud.height > self.MOST_TRACKS:
            raise RejectedMessageError(
                "oversize",
                f"{cloud.width * cloud.height} tracks, at most {self.MOST_TRACKS} are allowed",
            )
        found = estimates.from_msg(cloud)
        stamp_ns, numbers = found.stamp_ns, found.track_id.tolist()
        if stamp_ns < self.stamp_ns:  # A new run reuses the track numbers for other tracks.
            ended = {n: track for n, track in self._reported.items() if n not in numbers}
            self._lives, self._reported = {}, ended
        self.stamp_ns, self._found = stamp_ns, found
        lives = {}
        for number, state in zip(numbers, found.track_state, strict=True):
            life = self._lives.get(number) or _Life(self.stamp_ns, self.stamp_ns)
            if state != COASTING:
                life.seen_ns = self.stamp_ns
            lives[number] = life
        self._lives = lives

    def datagrams(self, time_ns: int) -> list[bytes]:
        """Return the data blocks of all tracks at a time, and of the tracker's own state."""
        tracks = self.reports(time_ns)
        self.tracks += len(tracks)
        found = tracks_out.track_blocks(tracks, time_ns, self.source)
        found.append(tracks_out.status_block(time_ns, self.source, self.batch))
        self.batch += 1
        return found

    def reports(self, time_ns: int) -> list[TrackReport]:
        """Return the tracks at a time; an ended track is reported a last time."""
        found = {}
        ahead_s = (time_ns - self.stamp_ns) * 1e-9
        if self._found is not None and abs(ahead_s) <= self._max_prediction_s:
            found = self._predict(self._found, time_ns, ahead_s)
        ended = [
            replace(track, first=False, last=True)
            for number, track in self._reported.items()
            if number not in found
        ]
        self._reported = found
        return [*found.values(), *ended]

    def _predict(
        self, estimated: Estimates, time_ns: int, ahead_s: float
    ) -> dict[int, TrackReport]:
        space, jacobian = estimated.space, self._TURN.jacobian(estimated.state, ahead_s)
        covariance = jacobian @ estimated.covariance @ jacobian.transpose(0, 2, 1)
        covariance += self._noise(estimated, abs(ahead_s))
        later = replace(
            estimated, state=self._TURN.mean(estimated.state, ahead_s), covariance=covariance
        )
        position, velocity = later.position, later.velocity.tolist()
        geodetic = None
        if self._plane is not None:
            geodetic = np.stack(self._plane.to_geodetic(*position.T), axis=1).tolist()
        std = _deviations(covariance)
        position_std, velocity_std = std[:, list(space.position)], std[:, list(space.velocity)]
        known = estimated.known_attributes
        height = self._datum + known.height @ np.array([1.0, ahead_s])
        climbed = np.array([[1.0, ahead_s], [0.0, 1.0]])
        up_std = _deviations(climbed @ known.height_covariance @ climbed.T)
        ages = known.ages_s(time_ns).tolist()
        members = estimated.members
        told = estimated.reports or Reported.unknown(len(estimated))
        owned = (told.owned > self.OWNED) | (told.alone == 1)
        by_icao = owned & (told.space == ICAO)
        addresses = np.where(by_icao & (known.address == NONE), told.address, known.address)
        heard = by_icao & (told.heard_ns > 0)
        report_age_s = np.where(heard, (time_ns - told.heard_ns) * 1e-9, np.nan).clip(min=0.0)
        found: dict[int, TrackReport] = {}
        for row in np.flatnonzero(estimated.track_id > 0).tolist():
            number = int(estimated.track_id[row])
            life, climb = self._lives[number], float(known.height[row, 1])
            address, named = int(addresses[row]), NONE
            if owned[row]:
                named = call_sign_of(text_of(told.name[row]))
            turn, turn_std = (float(of[row, space.turn_rate]) for of in (later.state, std))
            found[number] = TrackReport(
                # ASTERIX has 16 bits for a track number, and none is 0.
                number=(number - 1) % (2**16 - 1) + 1,
                position=tuple(position[row].tolist()),
                velocity=tuple(velocity[row]),
                geodetic=None if geodetic is None else tuple(geodetic[row]),
                height=float(height[row]),
                pressure_altitude=float(height[row]) + estimated.pressure_above,
                geometric=bool(space.vertical),
                climb=climb,
                code=int(known.code[row]),
                address=address,
                course=_course(turn, turn_std),
                vertical=_vertical(climb),
                confirmed=int(estimated.track_state[row]) in (CONFIRMED, COASTING),
                coasting=int(estimated.track_state[row]) == COASTING,
                first=number not in self._reported,
                age_s=max(0.0, (time_ns - life.first_ns) * 1e-9),
                since_s=max(0.0, (time_ns - life.seen_ns) * 1e-9),
                sensor_ages_s=tuple(ages[row]),
                position_std=tuple(position_std[row].tolist()),
                velocity_std=tuple(velocity_std[row].tolist()),
                covariance=float(later.position_covariance[row, 0, 1]),
                height_std=float(up_std[row, 0]),
                climb_std=float(up_std[row, 1]),
                composed=() if members is None else _composed(members[row].tolist()),
                call_sign=self._call_signs.of(address) if named == NONE else named,
                report_age_s=float(report_age_s[row]),
                alone=bool(told.alone[row]),
                unheard=bool(told.silent[row] > self.OWNED),
            )
        return found

    def _noise(self, estimated: Estimates, dt: float) -> FloatArray:
        """Return the process noise of each estimate in `dt` seconds, (T, D, D).

        It is the mean over classes and motion modes; zero if these are not known.
        """
        modes, classes = self.modes, estimated.class_probability
        known = modes is not None and modes.space == estimated.space
        if modes is None or not known or len(modes.classes) != classes.shape[1]:
            return np.zeros_like(estimated.covariance)
        share = classes[:, modes.class_of] * modes.motion_share
        noise: FloatArray = np.einsum("to,oij->tij", share, modes.noise(dt))
        return noise


def _composed(members: list[int]) -> tuple[tuple[int, int], ...]:
    """Return the trackers that have a track, the owner first, as in `TrackReport.composed`."""
    owner, *numbers = members
    having = [tracker for tracker, number in enumerate(numbers) if number and tracker != owner]
    return tuple((tracker + 1, numbers[tracker]) for tracker in (owner, *having))


def _deviations(covariance: FloatArray) -> FloatArray:
    """Return the standard deviations of covariances, shape (N, D)."""
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))


def _course(omega: float, std: float) -> int:
    if abs(omega) < LEAST_TURN:
        return tracks_out.STRAIGHT
    if abs(omega) < TURN_DEVIATIONS * std:
        return tracks_out.UNKNOWN
    return tracks_out.LEFT if omega > 0.0 else tracks_out.RIGHT


def _vertical(climb: float) -> int:
    if not math.isfinite(climb):
        return tracks_out.UNKNOWN
    if abs(climb) < LEAST_CLIMB:
        return tracks_out.LEVEL
    return tracks_out.CLIMBING if climb > 0.0 else tracks_out.DESCENDING


# Longest prediction of estimates, seconds: some revolutions of a radar. Tracks without newer
# estimates end after it.
MAX_PREDICTION_S = 10.0


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


def track_output(bridge: Bridge, monosensor: bool, call_signs: CallSigns) -> TrackOutput:
    """Return the encoder of estimates; `call_signs` may grow with the radars' plots."""
    values = bridge.values
    origin = values["world_origin"]
    sac, sic, service = map(int, values["output_source"])
    source = Source(sac, sic, service, monosensor, values["output_heights"] == "geometric")
    plane = SystemPlane(origin) if origin else None
    return TrackOutput(source, plane, MAX_PREDICTION_S, call_signs)


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
