"""The tracker's estimates as ASTERIX, predicted to the time of output."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from sensor_msgs.msg import PointCloud2

from msg_adapters.encoding import RejectedMessageError
from msg_adapters.targets import estimates
from phd_jdtc_ros.asterix import writing as tracks_out
from phd_jdtc_ros.asterix.messages import NONE, CallSigns, call_sign_of
from phd_jdtc_ros.asterix.writing import Source, TrackReport
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.targets.modes import ModeSpace
from phd_jdtc_ros.core.targets.motion import CoordinatedTurn
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, Estimates, Reported
from phd_jdtc_ros.core.types.reports import ICAO, text_of
from phd_jdtc_ros.earth import SystemPlane

from .configuration import Bridge

# Longest prediction of estimates, seconds: some revolutions of a radar. Tracks without newer
# estimates end after it.
MAX_PREDICTION_S = 10.0
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


def track_output(bridge: Bridge, monosensor: bool, call_signs: CallSigns) -> TrackOutput:
    """Return the encoder of estimates; `call_signs` may grow with the radars' plots."""
    values = bridge.values
    origin = values["world_origin"]
    sac, sic, service = map(int, values["output_source"])
    source = Source(sac, sic, service, monosensor, values["output_heights"] == "geometric")
    plane = SystemPlane(origin) if origin else None
    return TrackOutput(source, plane, MAX_PREDICTION_S, call_signs)
