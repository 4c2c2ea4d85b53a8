"""Places on the earth in tables: latitudes and longitudes become x and y in the system plane."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from phd_jdtc_ros.earth import SystemPlane

from .tables import Columns, numbers, place_of, with_column

# Columns of positions.
POSITION = ("x", "y")
# Columns in degrees, with the largest magnitude of each.
NAMES = (("lat", "lon"), ("latitude", "longitude"))
MOST_DEG = (90.0, 360.0)
# Columns x and y seem to be in degrees if they span less than this, this many times farther from 0.
SPAN, AWAY = 1.5, 30.0


def names(columns: Collection[str]) -> tuple[str, str] | None:
    """Return the columns of latitudes and longitudes; None without them, or beside others."""
    if {"range", *POSITION} & {*columns}:
        return None
    return next((pair for pair in NAMES if {*pair} <= {*columns}), None)


def middle(columns: Columns) -> list[float] | None:
    """Return the median place with the height 0, as ``world_origin``; None without places."""
    pair = names(columns)
    places = [] if pair is None else [numbers(columns, name) for name in pair]
    if not places or not np.isfinite(places).all(axis=0).any():
        return None
    return [*np.round(np.nanmedian(places, axis=1), 3).tolist(), 0.0]


def in_plane(columns: Columns, origin: Sequence[float]) -> Columns:
    """Return columns with x to the east and y to the north of a place, metres.

    Raise `ValueError` if there is no origin, or a value is no latitude or longitude.
    """
    pair = names(columns)
    if pair is None:
        return columns
    if not origin:
        raise ValueError(
            f"{', '.join(pair)}: given, needs world_origin, the latitude, longitude and height of "
            "x = y = 0, which fit takes from the table; or give x and y in metres"
        )
    degrees = [numbers(columns, name) for name in pair]
    for name, column, most in zip(pair, degrees, MOST_DEG, strict=True):
        if (bad := np.abs(column) > most).any():  # False for NaN
            row = int(np.argmax(bad))
            raise ValueError(
                f"{name}: {column[row]:g} in {place_of(columns, row)}, must be from {-most:g} to "
                f"{most:g} degrees"
            )
    unknown = np.isnan(degrees).any(axis=0)
    plane = SystemPlane(origin).to_plane(
        *np.where(unknown, np.asarray(origin[:2])[:, None], degrees)
    )
    for name, column in zip(POSITION, plane, strict=True):
        columns = with_column(columns, name, np.where(unknown, np.nan, column))
    return columns


def seem_degrees(columns: Columns) -> str:
    """Return the sentence about x and y that seem to be in degrees; empty if they do not."""
    if not {*POSITION} <= {*columns}:
        return ""
    x, y = (numbers(columns, name) for name in POSITION)
    low, mid, high = (
        np.nanquantile([x, y], [0.05, 0.5, 0.95], axis=1) if len(x) else np.zeros((3, 2))
    )
    span = float((high - low).max())
    degrees = abs(mid[0]) <= 180.0 and abs(mid[1]) <= 90.0
    if not (degrees and 0.0 < span < SPAN and np.hypot(*mid) > AWAY * span):
        return ""
    return (
        f"x and y are within {span:.2g} of ({mid[0]:.6g}, {mid[1]:.6g}): they must be metres; if "
        "they are degrees, name them lon and lat"
    )
