"""The tracker's estimates as ASTERIX, predicted to the time of output."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2

from msg_adapters import identities, point_cloud, stamps
from msg_adapters.errors import RejectedMessageError
from phd_jdtc_ros.asterix.call_signs import CallSigns
from phd_jdtc_ros.asterix.writing import tracks as tracks_out
from phd_jdtc_ros.asterix.writing.tracks import Source, TrackReport
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.types import COASTING, CONFIRMED

# Turns and climbs below these are none, rad/s and m/s (300 ft/min); and a turn is one only if it
# is so many deviations.
LEAST_TURN, LEAST_CLIMB, TURN_DEVIATIONS = math.radians(0.5), 1.5, 2.0
# Tracks that are sent at once: each is a message of its own.
MOST_TRACKS = 10_000
# Numbers of tracks in ASTERIX.
TRACK_NUMBERS = 2**16
_FLOATS = (
    "x",
    "y",
    "vx",
    "vy",
    "omega",
    "cov_00",
    "cov_02",
    "cov_11",
    "cov_22",
    "cov_33",
    "cov_44",
)
_VERTICAL = ("z", "vz", "cov_zz", "cov_vzvz")
_IDENTITIES = {"code": identities.CODES, "address": identities.ADDRESSES}
_AGES = ("age_psr", "age_ssr", "age_mds")
FloatArray = npt.NDArray[np.float64]


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
        self._columns: Mapping[str, npt.NDArray[Any]] | None = None
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
        columns = _columns(cloud)
        stamp_ns = stamps.of_header(cloud.header)
        if stamp_ns < self.stamp_ns:  # of a new run, which uses the same numbers for other tracks
            again = set(columns["track_id"].tolist())
            ended = {n: track for n, track in self._reported.items() if n not in again}
            self._lives, self._reported = {}, ended
        self.stamp_ns, self._columns = stamp_ns, columns
        lives = {}
        for number, state in zip(columns["track_id"], columns["state"], strict=True):
            life = self._lives.get(number) or _Life(self.stamp_ns, self.stamp_ns)
            if state != COASTING:
                life.seen_ns = self.stamp_ns
            lives[int(number)] = life
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
        if self._columns is not None and abs(ahead_s) <= self._max_prediction_s:
            found = self._predicted(self._columns, time_ns, ahead_s)
        ended = [
            replace(track, first=False, last=True)
            for number, track in self._reported.items()
            if number not in found
        ]
        self._reported = found
        return [*found.values(), *ended]

    def _predicted(
        self, columns: Mapping[str, npt.NDArray[Any]], time_ns: int, ahead_s: float
    ) -> dict[int, TrackReport]:
        get = {name: column.astype(np.float64) for name, column in columns.items()}
        x, y, vx, vy = _moved(get, ahead_s)
        height = self._datum + get["z"] + ahead_s * get["vz"]
        geodetic = None if self._plane is None else np.stack(self._plane.to_geodetic(x, y), axis=1)
        std = {name: np.sqrt(np.maximum(get[name], 0.0)) for name in get if name.startswith("cov_")}
        psr, ssr, mds = (np.maximum(get[name] + ahead_s, 0.0).tolist() for name in _AGES)
        ages = list(zip(psr, ssr, mds, strict=True))
        found: dict[int, TrackReport] = {}
        for row, number in enumerate(map(int, columns["track_id"])):
            life = self._lives[number]
            climb = float(get["vz"][row])
            known = number in self._reported
            found[number] = TrackReport(
                (number - 1) % (TRACK_NUMBERS - 1) + 1,
                (float(x[row]), float(y[row])),
                (float(vx[row]), float(vy[row])),
                None if geodetic is None else (float(geodetic[row, 0]), float(geodetic[row, 1])),
                float(height[row]),
                climb,
                int(columns["code"][row]),
                int(columns["address"][row]),
                _course(float(get["omega"][row]), float(std["cov_44"][row])),
                _vertical(climb),
                int(columns["state"][row]) in (CONFIRMED, COASTING),
                int(columns["state"][row]) == COASTING,
                first=not known,
                age_s=max(0.0, (time_ns - life.first_ns) * 1e-9),
                since_s=max(0.0, (time_ns - life.seen_ns) * 1e-9),
                sensor_ages_s=ages[row],
                position_std=(float(std["cov_00"][row]), float(std["cov_22"][row])),
                velocity_std=(float(std["cov_11"][row]), float(std["cov_33"][row])),
                covariance=float(get["cov_02"][row]),
                height_std=float(std["cov_zz"][row]),
                climb_std=float(std["cov_vzvz"][row]),
                call_sign=self._call_signs.of(int(columns["address"][row])),
            )
        return found


def _columns(cloud: PointCloud2) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a cloud's tracks that have a number; unknown is NaN or `UNKNOWN`."""
    if cloud.width * cloud.height > MOST_TRACKS:
        raise RejectedMessageError(
            "oversize", f"{cloud.width * cloud.height} tracks, at most {MOST_TRACKS} are allowed"
        )
    there = set(point_cloud.field_names(cloud))
    aged = all(name in there for name in _AGES)
    floats = [*_FLOATS, *(_VERTICAL if "cov_zz" in there else ()), *(_AGES if aged else ())]
    whole = ["track_id", *(name for name in ("state", *_IDENTITIES) if name in there)]
    wanted = dict.fromkeys(floats, point_cloud.FLOATS) | dict.fromkeys(whole, point_cloud.UNSIGNED)
    found = point_cloud.decode(cloud, wanted)
    point_cloud.require_finite({name: found[name] for name in _FLOATS})
    size = len(found["x"])
    found.setdefault("state", np.full(size, CONFIRMED))
    for name in (*_VERTICAL, *_AGES):
        found.setdefault(name, np.full(size, math.nan))
    known = np.all([point_cloud.finite(found[name]) for name in _VERTICAL], axis=0)
    for name in _VERTICAL:
        found[name] = np.where(known, found[name], math.nan)
    for name, numbers in _IDENTITIES.items():
        column = found.get(name, np.full(size, identities.NONE)).astype(np.float64)
        known_numbers, _ = identities.read(column, np.ones(size, dtype=bool), numbers)
        found[name] = np.asarray(known_numbers)
    labelled = found["track_id"] > 0
    return {name: column[labelled] for name, column in found.items()}


def _moved(
    get: Mapping[str, FloatArray], ahead_s: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return positions and velocities some seconds on, in a turn with the turn rate."""
    vx, vy, omega = get["vx"], get["vy"], get["omega"]
    angle = omega * ahead_s
    # sin(a) / a and (1 - cos(a)) / a, which are 1 and 0 without a turn.
    along = np.sinc(angle / math.pi)
    across = np.sin(0.5 * angle) * np.sinc(0.5 * angle / math.pi)
    cos, sin = np.cos(angle), np.sin(angle)
    return (
        get["x"] + ahead_s * (along * vx - across * vy),
        get["y"] + ahead_s * (across * vx + along * vy),
        cos * vx - sin * vy,
        sin * vx + cos * vy,
    )


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
