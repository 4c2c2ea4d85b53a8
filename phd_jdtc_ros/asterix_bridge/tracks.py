"""The tracker's estimates as ASTERIX, predicted to the time of output."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from sensor_msgs.msg import PointCloud2

from msg_adapters import estimates
from msg_adapters.errors import RejectedMessageError
from phd_jdtc_ros.asterix import tracks_out
from phd_jdtc_ros.asterix.call_signs import CallSigns
from phd_jdtc_ros.asterix.tracks_out import Source, TrackReport
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.state_space import OMEGA, VX, VY, X, Y
from phd_jdtc_ros.core.targets.motion import CoordinatedTurn
from phd_jdtc_ros.core.types import COASTING, CONFIRMED, UNKNOWN, Attributes, Estimates

# Turns and climbs below these are none, rad/s and m/s (300 ft/min); and a turn is one only if it
# is so many deviations.
LEAST_TURN, LEAST_CLIMB, TURN_DEVIATIONS = math.radians(0.5), 1.5, 2.0
# Tracks that are sent at once: each is a message of its own.
MOST_TRACKS = 10_000
# Numbers of tracks in ASTERIX.
TRACK_NUMBERS = 2**16
# The mean of a track's next state; with a turn rate of zero it is a straight line.
NOISE_FREE = CoordinatedTurn(noise_density=0.0, turn_noise_density=0.0)


@dataclass
class _Life:
    """When a track was first reported, and last seen."""

    first_ns: int
    seen_ns: int


class TrackOutput:
    """Takes clouds of estimates, returns data blocks.

    Parameters
    ----------
    source : Source
    plane : Plane or None
        Without one there are no latitudes and longitudes, and heights are those above the world's
        zero.
    max_prediction_s : float
        Estimates that are older are not predicted any more, and their tracks end.
    call_signs : CallSigns
        Those of the tracks' addresses.
    """

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
        # Estimates have heights above the map's zero, which need not be that of flight levels.
        self._datum = 0.0 if plane is None else plane.origin[2]
        self._max_prediction_s = max_prediction_s
        self._estimates: Estimates | None = None
        self.stamp_ns = 0
        self._lives: dict[int, _Life] = {}
        self._reported: dict[int, TrackReport] = {}
        self.batch = 0
        self.tracks = 0

    def take(self, cloud: PointCloud2) -> None:
        """Take the estimates of a cloud in the place of those before.

        Raises
        ------
        RejectedMessageError
            If it is no such cloud.
        """
        found = _numbered(cloud)
        stamp_ns = found.stamp_ns
        if stamp_ns < self.stamp_ns:  # of a new run, which uses the same numbers for other tracks
            again = set(found.track_id.tolist())
            ended = {n: track for n, track in self._reported.items() if n not in again}
            self._lives, self._reported = {}, ended
        self.stamp_ns, self._estimates = stamp_ns, found
        lives = {}
        for number, state in zip(found.track_id.tolist(), found.track_state, strict=True):
            life = self._lives.get(number) or _Life(self.stamp_ns, self.stamp_ns)
            if state != COASTING:
                life.seen_ns = self.stamp_ns
            lives[number] = life
        self._lives = lives

    def datagrams(self, time_ns: int) -> list[bytes]:
        """Return the data blocks of all tracks at a time, and that of the tracker's own state."""
        tracks = self.reports(time_ns)
        self.tracks += len(tracks)
        found = tracks_out.track_blocks(tracks, time_ns, self.source)
        found.append(tracks_out.status_block(time_ns, self.source, self.batch))
        self.batch += 1
        return found

    def reports(self, time_ns: int) -> list[TrackReport]:
        """Return the tracks at a time; one that there is no more, a last time."""
        found = {}
        ahead_s = (time_ns - self.stamp_ns) * 1e-9
        if self._estimates is not None and abs(ahead_s) <= self._max_prediction_s:
            found = self._predicted(self._estimates, time_ns, ahead_s)
        ended = [
            replace(track, first=False, last=True)
            for number, track in self._reported.items()
            if number not in found
        ]
        self._reported = found
        return [*found.values(), *ended]

    def _predicted(self, found: Estimates, time_ns: int, ahead_s: float) -> dict[int, TrackReport]:
        state = NOISE_FREE.mean(found.state, ahead_s)
        jacobian = NOISE_FREE.jacobian(found.state, ahead_s)
        covariance = jacobian @ found.covariance @ jacobian.transpose(0, 2, 1)
        known = _predicted_attributes(found, time_ns)
        std, height_std = _deviations(covariance), _deviations(known.height_covariance)
        plane, ages = self._plane, _ages(known, time_ns)
        geodetic = None
        if plane is not None:
            geodetic = np.stack(plane.to_geodetic(state[:, X], state[:, Y]), axis=1).tolist()
        tracks: dict[int, TrackReport] = {}
        for row, number in enumerate(found.track_id.tolist()):
            life, track_state = self._lives[number], int(found.track_state[row])
            height, climb = known.height[row].tolist()
            address = int(known.address[row])
            tracks[number] = TrackReport(
                (number - 1) % (TRACK_NUMBERS - 1) + 1,
                (float(state[row, X]), float(state[row, Y])),
                (float(state[row, VX]), float(state[row, VY])),
                None if geodetic is None else tuple(geodetic[row]),
                self._datum + height,
                climb,
                int(known.code[row]),
                address,
                _course(float(state[row, OMEGA]), float(std[row, OMEGA])),
                _vertical(climb),
                track_state in (CONFIRMED, COASTING),
                track_state == COASTING,
                first=number not in self._reported,
                age_s=max(0.0, (time_ns - life.first_ns) * 1e-9),
                since_s=max(0.0, (time_ns - life.seen_ns) * 1e-9),
                sensor_ages_s=ages[row],
                position_std=(float(std[row, X]), float(std[row, Y])),
                velocity_std=(float(std[row, VX]), float(std[row, VY])),
                covariance=float(covariance[row, X, Y]),
                height_std=float(height_std[row, 0]),
                climb_std=float(height_std[row, 1]),
                call_sign=self._call_signs.of(address),
            )
        return tracks


def _numbered(cloud: PointCloud2) -> Estimates:
    """Return the estimates of a cloud that have a track number."""
    if cloud.width * cloud.height > MOST_TRACKS:
        raise RejectedMessageError(
            "oversize", f"{cloud.width * cloud.height} tracks, at most {MOST_TRACKS} are allowed"
        )
    found = estimates.from_msg(cloud)
    return found.take(np.flatnonzero(found.track_id > 0))


def _predicted_attributes(found: Estimates, time_ns: int) -> Attributes:
    """Return heights and climb rates at a time with their covariances, and identities."""
    known = Attributes.unknown(len(found)) if found.attributes is None else found.attributes
    ahead_s = (time_ns - found.stamp_ns) * 1e-9
    climbed = np.array([[1.0, ahead_s], [0.0, 1.0]])
    return replace(
        known,
        height=known.height @ climbed.T,
        height_covariance=climbed @ known.height_covariance @ climbed.T,
    )


def _ages(known: Attributes, time_ns: int) -> list[tuple[float, float, float]]:
    """Return the seconds since each kind of sensor saw the tracks; NaN where none did."""
    if known.seen_ns is None:
        return [(math.nan, math.nan, math.nan)] * len(known.code)
    ages = np.maximum((time_ns - known.seen_ns) * 1e-9, 0.0)
    ages = np.where(known.seen_ns == UNKNOWN, np.nan, ages)
    return [(psr, ssr, mds) for psr, ssr, mds in ages.tolist()]


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
