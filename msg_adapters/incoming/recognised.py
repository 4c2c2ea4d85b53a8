"""Infers how a sensor's clouds are read from the names and values of their fields."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.columns import ground_ranges
from phd_jdtc_ros.configuration.parameters.sensor import TIME_UNITS
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import FULL_TURN

from ..encoding import RejectedMessageError, point_cloud, stamps
from .detections import DOUBLES, NUMBERS, SYNONYMS

# Usual names of fields in lower case, the most common first, by the parameter that names the field.
NAMES: Mapping[str, Sequence[str]] = {
    "fields.range": ("range", *SYNONYMS["range"]),
    "fields.azimuth": ("azimuth", *SYNONYMS["azimuth"]),
    "fields.elevation": ("elevation_angle", "elevation", "el"),
    "fields.amplitude": ("amplitude", *SYNONYMS["amplitude"], "power", "intensity", "rcs"),
    "fields.time": ("time", "time_of_detection", "t", "timestamp", "time_offset", "stamp"),
    "fields.height": ("height", "altitude"),
    "fields.range_std": ("range_std", "sigma_range"),
    "fields.azimuth_std": ("azimuth_std", "sigma_azimuth"),
}
IN_DB = ("snr", "snr_db", "power", "rcs")
# Allowed types of a field, where they differ from floats.
TYPES: Mapping[str, Sequence[str]] = {"fields.amplitude": NUMBERS}
# A unit of time is rejected if it puts detections farther from the stamp than FARTHEST_S seconds,
# or than FARTHEST_INTERVALS times the interval between clouds.
FARTHEST_S, FARTHEST_INTERVALS = 60.0, 20.0


# Usual names of the fields of positions, likewise.
POSITIONS: Mapping[str, Sequence[str]] = {
    "fields.x": ("x", "pos_x", "position_x", "x_pos", "px", "center_x", "centroid_x"),
    "fields.y": ("y", "pos_y", "position_y", "y_pos", "py", "center_y", "centroid_y"),
    "fields.x_std": ("x_std", "sigma_x", "std_x", "x_rms"),
    "fields.y_std": ("y_std", "sigma_y", "std_y", "y_rms"),
    "fields.correlation": ("correlation", "correlation_xy", "rho_xy"),
    "fields.vx": ("vx", "velocity_x", "vel_x"),
    "fields.vy": ("vy", "velocity_y", "vel_y"),
    "fields.vz": ("vz", "velocity_z", "vel_z"),
    "fields.time": NAMES["fields.time"],
}


def is_of_radar(fields: Sequence[str]) -> bool:
    """Return whether a cloud with these fields has ranges and azimuths."""
    return _has_all(fields, NAMES, ("fields.range", "fields.azimuth"))


def is_of_positions(fields: Sequence[str]) -> bool:
    """Return whether a cloud with these fields has positions, and not both ranges and azimuths."""
    return _has_all(fields, POSITIONS, ("fields.x", "fields.y")) and not is_of_radar(fields)


def _has_all(
    fields: Sequence[str], names: Mapping[str, Sequence[str]], parameters: Sequence[str]
) -> bool:
    present = {name.lower() for name in fields}
    return all(present.intersection(names[parameter]) for parameter in parameters)


def parameters(clouds: Sequence[PointCloud2]) -> dict[str, Any] | None:
    """Return the parameters for reading a sensor's clouds, None if they have no known place.

    A range and an azimuth are a radar's, and x and y without one of them are positions. The
    parameters are ``fields.range`` and so on, units and conventions, without the sensor's name. At
    least one of the clouds, which are of one topic, must have points.
    """
    full = [cloud for cloud in clouds if cloud.width * cloud.height]
    if not full:
        return None
    found: dict[str, Any] = {"frame": full[0].header.frame_id}
    for parameter, names in NAMES.items():
        columns = {name: _column(full, parameter, name) for name in _present(full[0], names)}
        usable = [name for name, column in columns.items() if column is not None]
        if usable:
            found[parameter] = usable[0]
    if not {"fields.range", "fields.azimuth"} <= set(found):
        return _of_positions(full)
    found.setdefault("fields.amplitude", "")
    if "fields.elevation" in found and not _has_elevations(full, found["fields.elevation"]):
        del found["fields.elevation"]  # All elevations are zero, so ranges are ground ranges
    if "fields.elevation" in found:
        found.update(_elevations(full, found["fields.elevation"]))
    found.update(_azimuths(full, found["fields.azimuth"]))
    if found["fields.amplitude"].lower() in IN_DB:
        found["units.amplitude"] = "db"
    if "fields.time" in found:
        times = _times(full, found["fields.time"])
        if times is None:
            del found["fields.time"]
        else:
            found.update(times)
    return found


def _of_positions(clouds: Sequence[PointCloud2]) -> dict[str, Any] | None:
    """Return the parameters for reading clouds of positions, None if they have none."""
    found: dict[str, Any] = {"kind": "position", "frame": clouds[0].header.frame_id}
    # Fields of what trackers publish: tracks, and detections of other sensors.
    if {"track_id", "radar_index"}.intersection(point_cloud.field_names(clouds[0])):
        return None
    # Clouds with more points are not detections, but what a lidar measures of all surfaces.
    if np.median([cloud.width * cloud.height for cloud in clouds]) > 2000:
        return None
    for parameter, names in POSITIONS.items():
        present = _present(clouds[0], names)
        usable = [name for name in present if _column(clouds, parameter, name) is not None]
        if usable and usable[0] != names[0]:
            found[parameter] = usable[0]
        elif not usable and parameter in ("fields.x", "fields.y"):
            return None
        elif usable and parameter == "fields.time":
            found[parameter] = usable[0]
    if "fields.time" in found:
        times = _times(clouds, found["fields.time"])
        found |= times or {}
        if times is None:
            del found["fields.time"]
    return found


def _present(cloud: PointCloud2, names: Sequence[str]) -> list[str]:
    """Return the cloud's fields with one of the given names, in the order of the names.

    Names may end with a unit: that of azimuths, elevations and times is told by their values.
    """
    fields = point_cloud.field_names(cloud)[::-1]
    own = {re.sub("_(m|mps|rad|deg|s)$", "", name.lower()): name for name in fields}
    own |= {name.lower(): name for name in fields}
    return [own[name] for name in names if name in own]


def _column(clouds: Sequence[PointCloud2], parameter: str, name: str) -> FloatArray | None:
    """Return all values of a field, None if it is not readable."""
    types = TYPES.get(parameter, point_cloud.FLOATS)
    try:
        parts = [point_cloud.decode(cloud, {name: types})[name] for cloud in clouds]
    except RejectedMessageError:
        return None
    return np.concatenate(parts).astype(np.float64)


def _has_elevations(clouds: Sequence[PointCloud2], name: str) -> bool:
    column = _column(clouds, "fields.elevation", name)
    return column is not None and bool(np.nan_to_num(column).any())


def _elevations(clouds: Sequence[PointCloud2], name: str) -> dict[str, Any]:
    """Return unit and sense of elevations: from their values, and from z if it is present."""
    elevation, up = _column(clouds, "fields.elevation", name), _column(clouds, "", "z")
    if elevation is None:
        return {}
    unit = ground_ranges.unit_of(elevation)
    down = up is not None and bool(np.nansum(elevation * up) < 0.0)
    words = f"down_{unit}" if down and unit != "mrad" else unit
    return {} if words == "rad" else {"units.elevation": words}


def _azimuths(clouds: Sequence[PointCloud2], name: str) -> dict[str, Any]:
    """Return unit and convention of azimuths, from x and y if present, else from the values."""
    azimuth = _column(clouds, "fields.azimuth", name)
    ahead, left = (_column(clouds, "", axis) for axis in ("x", "y"))
    if azimuth is None:
        return {}
    unit = "deg" if np.nanmax(np.abs(azimuth), initial=0.0) > 1.01 * FULL_TURN else "rad"
    settings: dict[str, Any] = {"units.azimuth": unit}
    if ahead is None or left is None or not np.nan_to_num([ahead, left]).any():
        return settings
    true = np.arctan2(left, ahead)
    fits = {}
    for units, radians in (("rad", azimuth), ("deg", np.radians(azimuth))):
        for convention, counted in (("enu_ccw", radians), ("compass_cw", 0.5 * np.pi - radians)):
            fits[units, convention] = float(np.nanmean(np.cos(counted - true)))
    (units, convention), fit = max(fits.items(), key=lambda entry: entry[1])
    if fit > 0.99:
        settings = {"units.azimuth": units, "units.azimuth_convention": convention}
    return settings


def _times(clouds: Sequence[PointCloud2], name: str) -> dict[str, Any] | None:
    """Return unit and reference of the detection times, None if no unit fits the stamps."""
    steps_s = np.diff([stamps.to_ns(cloud.header.stamp) * 1e-9 for cloud in clouds])
    limit_s = FARTHEST_S
    if len(steps_s):
        limit_s = min(FARTHEST_S, FARTHEST_INTERVALS * float(np.median(steps_s)))
    for reference, types in (("epoch", DOUBLES), ("stamp", point_cloud.FLOATS)):
        farthest = dict.fromkeys(TIME_UNITS, 0.0)
        for cloud in clouds:
            try:
                column = point_cloud.decode(cloud, {name: types})[name].astype(np.float64)
            except RejectedMessageError:
                break
            zero_s = stamps.to_ns(cloud.header.stamp) * 1e-9 if reference == "epoch" else 0.0
            for unit, seconds in TIME_UNITS.items():
                off = np.nanmax(np.abs(column * seconds - zero_s), initial=0.0)
                farthest[unit] = max(farthest[unit], float(off))
        else:
            # Times within this of the stamp, seconds, give no evidence of their unit.
            near = [unit for unit, off in farthest.items() if 1e-4 < off < limit_s]
            if near:
                return {"units.time": near[0], "units.time_reference": reference}
    return None
