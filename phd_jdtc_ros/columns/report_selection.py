"""Columns of self-reports, as clouds and tables have them, to `SelfReports`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from phd_jdtc_ros.configuration.parameters.reports import ReportsParameters
from phd_jdtc_ros.core.arrays import FloatArray, IntArray
from phd_jdtc_ros.core.snapshot import MAX_STAMP_NS
from phd_jdtc_ros.core.types import UNKNOWN, SelfReports
from phd_jdtc_ros.core.types.reports import NAME_SIZE, OTHER, SPACES, is_of

# Types and accuracies that mean that they are unknown.
NO_TYPE, NO_ACCURACY = 0, 255
# What no radar of ships has as a track, whatever type its message has.
NO_CRAFT = "coast_station", "aircraft", "aid_to_navigation"

PLACES = ("latitude", "longitude"), ("x", "y")
# The columns of numbers that reports may have, with the time.
QUANTITIES = (
    *("latitude", "longitude", "x", "y", "vx", "vy", "speed", "course", "heading", "height"),
    *("std", "x_std", "y_std", "correlation", "address", "space", "type", "accurate", "interval"),
    *("ahead", "left", "length"),
)
Columns = Mapping[str, npt.NDArray[Any]]


class Told(NamedTuple):
    """Self-reports of one message, and the numbers of those that were dropped, by reason."""

    reports: SelfReports
    dropped: Counter[str]


def select(stamp_ns: int | None, own: ReportsParameters, columns: Columns) -> Told:
    """Return the reports of columns by field name, without those that no place or time has.

    Parameters
    ----------
    stamp_ns : int or None
        Time of reports without one of their own; None if each must have one.
    columns : mapping of name to array of shape (M,)
        ``latitude longitude`` (degrees) or ``x y`` (metres in the world); further ones as in
        docs/reports.md. NaN is unknown.
    """
    # Addresses have 32 bits, of which the last number means that there is none; 0 is none too.
    no_address = (1 << 32) - 1
    # Longest interval of the reports of a transmitter, seconds.
    longest_s = 3600.0
    names = ("x", "y") if "x" in columns else ("latitude", "longitude")
    count = len(columns[names[0]])
    nan = np.full(count, np.nan)

    def floats(name: str) -> FloatArray:
        return np.asarray(columns.get(name, nan), dtype=np.float64)

    place = np.stack([floats(names[0]), floats(names[1])], axis=1)
    position, north = _in_plane(place, own) if "x" not in columns else (place, np.zeros(count))
    # Farther from the origin a position has a fault, metres: halfway around the earth.
    has_place = (np.abs(position) <= 2e7).all(axis=1)
    usual_s = np.nan if stamp_ns is None else stamp_ns * 1e-9
    time_s = np.where(np.isfinite(floats("time")), floats("time"), usual_s)
    has_time = (time_s >= 0.0) & (time_s <= MAX_STAMP_NS * 1e-9)
    address = floats("address")
    unnamed = np.isnan(address) | (address == no_address)
    sound = unnamed | ((address > 0) & (address < no_address) & (address % 1 == 0))
    space, usable = _space(floats("space"), own), has_place & has_time & sound
    others = [(name, usable & is_of(name, address, space)) for name in NO_CRAFT]
    kept = np.flatnonzero(usable & ~np.any([mask for _, mask in others], axis=0))
    reasons = ("place", ~has_place), ("time", has_place & ~has_time), ("address", ~sound), *others
    dropped = +Counter({reason: int(np.count_nonzero(mask)) for reason, mask in reasons})
    time_ns = np.rint(np.where(has_time, time_s, 0.0) * 1e9).astype(np.int64)
    if "time" not in columns and stamp_ns is not None:
        time_ns = np.full(count, stamp_ns)
    reports = SelfReports.of(
        time_ns[kept],
        position[kept],
        covariance=_covariance(floats)[kept],
        velocity=_velocity(floats, columns, north)[kept],
        heading=_direction(floats("heading"), north)[kept],
        height=floats("height")[kept] - (own.plane.origin[2] if own.plane is not None else 0.0),
        address=np.where(unnamed, UNKNOWN, np.where(sound, address, 0.0)).astype(np.int64)[kept],
        space=space[kept],
        type=_small(floats("type"), NO_TYPE)[kept],
        name=_names(columns.get("name"), count)[kept],
        accurate=_small(floats("accurate"), NO_ACCURACY)[kept],
        hull=np.stack([floats(name) for name in ("ahead", "left", "length")], axis=1)[kept],
        interval_s=_within(floats("interval"), 0.0, longest_s)[kept],
    )
    return Told(reports, dropped)


def _in_plane(place: FloatArray, own: ReportsParameters) -> tuple[FloatArray, FloatArray]:
    """Return positions of latitudes and longitudes, and the directions of north from the y axis."""
    latitude, longitude = place.T
    # AIS sends 91 and 181 for unknown ones.
    known = (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0)
    position, north = np.full(place.shape, np.nan), np.zeros(len(place))
    if own.plane is not None and known.any():
        x, y = own.plane.to_plane(latitude[known], longitude[known])
        position[known] = np.stack([x, y], axis=1)
        position[~np.isfinite(position)] = np.nan
        north[known] = own.plane.convergence(latitude[known], longitude[known])
    return position, north


def _direction(clockwise_deg: FloatArray, north: FloatArray) -> FloatArray:
    """Return directions in the world, radians counter-clockwise from x, of degrees from north."""
    known = (clockwise_deg >= 0.0) & (clockwise_deg <= 360.0)  # AIS sends 511 for an unknown one
    return np.where(known, 0.5 * np.pi + north - np.radians(clockwise_deg), np.nan)


def _velocity(floats: Any, columns: Columns, north: FloatArray) -> FloatArray:
    """Return velocities in the world; NaN where they are unknown."""
    if "vx" in columns:
        velocity = np.stack([floats("vx"), floats("vy")], axis=1)
    else:
        speed, course = floats("speed"), _direction(floats("course"), north)
        # A transmitter at rest has no course.
        course = np.where((speed == 0.0) & np.isnan(course), 0.0, course)
        velocity = speed[:, None] * np.stack([np.cos(course), np.sin(course)], axis=1)
    # Largest speed of a transmitter, metres per second: no aircraft is as fast.
    known = (np.abs(velocity) <= 2000.0).all(axis=1)
    return np.where(known[:, None], velocity, np.nan)


def _within(value: FloatArray, least: float, most: float) -> FloatArray:
    """Return values between bounds, above the lower one; NaN for others."""
    return np.where((value > least) & (value <= most), value, np.nan)


def _covariance(floats: Any) -> FloatArray:
    """Return covariances of positions; NaN where they are unknown."""
    both = floats("std")
    x_std = np.where(np.isnan(floats("x_std")), both, floats("x_std"))
    y_std = np.where(np.isnan(floats("y_std")), both, floats("y_std"))
    correlation = np.nan_to_num(floats("correlation"), nan=0.0)
    covariance = np.full((len(both), 2, 2), np.nan)
    known = (x_std > 0.0) & (y_std > 0.0) & (np.abs(correlation) < 1.0)
    covariance[:, 0, 0] = np.where(known, x_std**2, np.nan)
    covariance[:, 1, 1] = np.where(known, y_std**2, np.nan)
    covariance[:, 0, 1] = covariance[:, 1, 0] = np.where(known, correlation * x_std * y_std, np.nan)
    return covariance


def _space(space: FloatArray, own: ReportsParameters) -> IntArray:
    known = (space >= 1) & (space <= OTHER)
    return np.where(known, np.where(known, space, 0), SPACES.index(own.identity)).astype(np.int64)


def _small(value: FloatArray, unknown: int) -> IntArray:
    known = (value >= 0) & (value <= 255) & (value != unknown)
    return np.where(known, np.where(known, value, 0), UNKNOWN).astype(np.int64)


def _names(name: npt.NDArray[Any] | None, count: int) -> IntArray:
    """Return names as numbers of letters; clouds have bytes, and tables text."""
    found = np.zeros((count, NAME_SIZE), dtype=np.int64)
    if name is None:
        return found
    if name.ndim == 2:
        found[:] = name
    else:
        for row, text in enumerate(name.tolist()):
            letters = str(text).encode("ascii", "replace")[:NAME_SIZE]
            found[row, : len(letters)] = list(letters)
    # Other bytes than letters could be commands to a terminal.
    found[(found < 32) | (found > 126)] = 0
    return found
