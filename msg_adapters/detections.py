"""A radar's point cloud to and from `Detections`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.configuration.radar_input import RadarInput
from phd_jdtc_ros.core.types import Detections

from . import point_cloud, sent_columns, stamps
from .errors import RejectedMessageError, quoted
from .selection import Columns, Report, select

# Some drivers send levels as whole decibels.
NUMBERS = (*point_cloud.FLOATS, "i1", "u1", "i2", "u2", "i4", "u4")
# Single precision leaves two minutes of the time since the epoch.
DOUBLES = ("f8",)
# Columns that may be whole numbers.
WHOLE = ("level", "sector", "code", "address", "kind")
# What a cloud may lack although the radar's configuration names its field.
OPTIONAL = (
    *("level", "time", "sector", "height", "code", "address", "kind", "range_std", "azimuth_std"),
    *("range_rate", "range_rate_std"),
)
# Further names of the fields that a radar has unless its parameters say otherwise, in lower case.
# An SNR is in decibels; what a power or an RCS is relative to only its driver knows.
SYNONYMS = {
    "range_field": ("rho", "distance", "dist", "radial_distance", "ground_range", "r"),
    "azimuth_field": ("azimuth_angle", "theta", "bearing", "az", "angle"),
    "amplitude_field": ("snr", "snr_db"),
}
# The layout of the clouds that are written where no radar's own is asked for.
OWN_LAYOUT = RadarInput(name="", topic="", frame="")


def to_msg(
    detections: Detections, stamp_ns: int, frame: str, radar: RadarInput = OWN_LAYOUT
) -> PointCloud2:
    """Return the cloud of a planar radar's detections, as that radar's driver would publish it.

    Parameters
    ----------
    radar : RadarInput
        Field names, units and conventions; by default those of the package.

    Returns
    -------
    PointCloud2
        Fields are ``x y z`` in the sensor's frame, then the radar's names for ``range azimuth
        elevation amplitude``, and those for the time, the sector, the height, the code, the
        address, the kind, the range rate and the deviations of each detection that it has. All are
        FLOAT32, but for the sector, the code and the address, UINT32, the kind, UINT8, and times
        since the epoch, FLOAT64.
        The elevation is 0; so is the height above the antenna if the detections have none.

    Raises
    ------
    ValueError
        If the radar has amplitudes or sectors and the detections have none.
    """
    distance, azimuth = detections.measurement.T
    place = {
        "x": distance * np.cos(azimuth),
        "y": distance * np.sin(azimuth),
        "z": np.zeros(len(detections)),
    }
    columns = {**place, **sent_columns.of(detections, stamp_ns, radar)}
    wide = {radar.time_field} if radar.time_since_epoch else frozenset()
    return point_cloud.encode(stamp_ns, frame, columns, wide)


def from_msg(cloud: PointCloud2, radar: RadarInput) -> Report:
    """Return the detections of a cloud; `radar` names its fields.

    Parameters
    ----------
    cloud : PointCloud2
        Range and azimuth (and elevation) are floats, as are times, heights, range rates and
        deviations; the amplitude, sector, code, address and kind may be whole numbers.
        Without a field that is none of a detection's coordinates, what it says is unknown; that is
        a doubt.
    radar : RadarInput
        Field names, units and conventions. Where it names an elevation or a height field, ranges
        are slant ranges.

    Raises
    ------
    RejectedMessageError
        ``frame`` if the cloud is in another frame than the radar's; see `stamps.of_header`
        and `point_cloud.decode`.
    """
    require_frame(cloud.header.frame_id, radar)
    there = set(point_cloud.field_names(cloud))
    radar = _recognised(radar, there)
    named = _named(radar)
    missing = [what for what in OPTIONAL if what in named and named[what][0] not in there]
    wanted = dict(entry for what, entry in named.items() if what not in missing)
    # Converting a signalling NaN warns; the point is dropped, or the value unknown, like any NaN.
    with np.errstate(invalid="ignore"):
        columns = {
            name: column.astype(np.float64)
            for name, column in point_cloud.decode(cloud, wanted).items()
        }
    found = {what: columns[name] for what, (name, _) in named.items() if name in columns}
    report = select(stamps.of_header(cloud.header), radar, Columns(**found))
    lacking = Counter(f"{what}_missing" for what in missing if what != "level")
    return replace(report, doubts=report.doubts + lacking) if lacking else report


def _recognised(radar: RadarInput, there: Collection[str]) -> RadarInput:
    """Return a radar's layout with the names that a cloud has for fields of other names."""
    lacking = {
        attribute: names
        for attribute, names in SYNONYMS.items()
        if getattr(radar, attribute) == getattr(OWN_LAYOUT, attribute)
        and getattr(radar, attribute) not in there
    }
    if not lacking:
        return radar
    taken = {*sent_columns.names_of(radar).values()}
    own = {name.lower(): name for name in sorted(there) if name not in taken}
    found: dict[str, Any] = {
        attribute: next(own[name] for name in names if name in own)
        for attribute, names in lacking.items()
        if not own.keys().isdisjoint(names)
    }
    if "amplitude_field" in found:
        found["amplitude_in_db"] = True
    return replace(radar, **found)


def _named(radar: RadarInput) -> dict[str, tuple[str, Sequence[str]]]:
    """Return the name and the allowed types of every field that a radar has, by its column."""
    types: dict[str, Sequence[str]] = dict.fromkeys(WHOLE, NUMBERS)
    if radar.time_since_epoch:
        types["time"] = DOUBLES
    return {
        what: (name, types.get(what, point_cloud.FLOATS))
        for what, name in sent_columns.names_of(radar).items()
    }


def require_frame(frame: str, radar: RadarInput) -> None:
    """Raise `RejectedMessageError` if a message is in another frame than its radar's."""
    if frame != radar.frame:
        raise RejectedMessageError("frame", f"frame_id {quoted(frame)}, must be {radar.frame!r}")
