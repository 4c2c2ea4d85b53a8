"""A radar's point cloud to and from `Detections`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from sensor_msgs.msg import PointCloud2

from phd_jdtc_ros.columns import sent_columns
from phd_jdtc_ros.columns.selection import Report, select
from phd_jdtc_ros.configuration.parameters import sensor
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.configuration.parameters.sensor import SensorParameters
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Detections

from ..encoding import RejectedMessageError, point_cloud, quote, stamps

# Numeric types of fields other than coordinates: some drivers send levels as whole decibels.
NUMBERS = (*point_cloud.FLOATS, "i1", "u1", "i2", "u2", "i4", "u4")
# Times since the epoch must be doubles, because single precision resolves only two minutes.
DOUBLES = ("f8",)
# Columns that may have integer types.
WHOLE = ("amplitude", "sector", "code", "address", "detection_type")
# Usual field names, in lower case, that are recognised if a radar's own name is missing, as is that
# name in other letter cases. An SNR is in decibels; a power or an RCS has a reference that only the
# driver defines.
SYNONYMS = {
    "range": ("rho", "distance", "dist", "radial_distance", "ground_range", "r"),
    "azimuth": ("azimuth_angle", "theta", "bearing", "az", "angle"),
    "amplitude": ("snr", "snr_db"),
}
# Default layout of written clouds.
OWN_LAYOUT = RadarParameters()


class Expected(NamedTuple):
    """The quantities that clouds of a kind of sensor must have, and those that they need not."""

    required: tuple[str, ...]  # If the sensor's configuration names their fields
    optional: tuple[str, ...] = ()  # Under their usual names


EXPECTED = Expected(required=("range", "azimuth", "elevation"))


def to_msg(
    detections: Detections, stamp_ns: int, frame: str, radar: RadarParameters = OWN_LAYOUT
) -> PointCloud2:
    """Encode a radar's detections as the cloud that the radar's driver would publish.

    The fields are ``x y z`` in the sensor's frame, then ``range azimuth elevation amplitude`` under
    the radar's names, and then those of time, sector, height, code, address, detection type, range
    rate and standard deviations that the radar has. All are FLOAT32, except for sector, code and
    address (UINT32), detection type (UINT8), and times since the epoch (FLOAT64). The elevation is
    0 in the plane; so is the height above the antenna if the detections have no height.

    Raise `ValueError` if the radar has amplitudes or sectors and the detections do not.
    """
    distance, azimuth, *elevation = detections.measurement.T
    up = elevation[0] if elevation else np.zeros(len(detections))
    level = distance * np.cos(up) if elevation else distance
    place = {"x": level * np.cos(azimuth), "y": level * np.sin(azimuth)}
    place["z"] = distance * np.sin(up)
    columns = {**place, **sent_columns.of(detections, stamp_ns, radar)}
    wide = {radar.fields.time} if radar.units.since_epoch else frozenset()
    return point_cloud.encode(stamp_ns, frame, columns, wide)


def from_msg(cloud: PointCloud2, radar: RadarParameters) -> Report:
    """Decode the detections of a cloud.

    Range, azimuth, elevation, times, heights, range rates and standard deviations are floats;
    amplitude, sector, code, address and detection type may also be integers. With an elevation or a
    height field, ranges are slant ranges. If the cloud lacks a configured field that is not a
    coordinate, its quantity is unknown: an anomaly. A cloud with neither points nor fields, such as
    a new message, is a report without detections.

    Raise `RejectedMessageError`: ``frame`` if the cloud is in another frame than the radar's;
    otherwise see `stamps.of_input` and `point_cloud.decode`.
    """
    require_frame(cloud.header.frame_id, radar)
    radar = _recognise_fields(radar, point_cloud.field_names(cloud))
    columns, missing = read_columns(cloud, radar.fields, radar.units.since_epoch, EXPECTED)
    report = select(stamps.of_input(cloud.header), radar, columns)
    return replace(report, anomalies=report.anomalies + missing) if missing else report


def _recognise_fields(radar: RadarParameters, present: Collection[str]) -> RadarParameters:
    """Return a radar's layout with the names that a cloud uses for missing fields."""
    lacking = {
        quantity: (quantity, *names)
        for quantity, names in SYNONYMS.items()
        if getattr(radar.fields, quantity) == quantity and quantity not in present
    }
    if not lacking:
        return radar
    taken = {*sent_columns.names_of(radar.fields).values()}
    own = {name.lower(): name for name in sorted(present) if name not in taken}
    found = {
        quantity: next(own[name] for name in names if name in own)
        for quantity, names in lacking.items()
        if not own.keys().isdisjoint(names)
    }
    in_db = found.get("amplitude", "amplitude").lower() != "amplitude" or radar.units.in_db
    units = replace(radar.units, amplitude="db" if in_db else "linear")
    return replace(radar, fields=replace(radar.fields, **found), units=units)


def read_columns(
    cloud: PointCloud2, fields: sensor.Fields, time_since_epoch: bool, expected: Expected
) -> tuple[dict[str, FloatArray], Counter[str]]:
    """Return the columns of a cloud by quantity, arrays of shape (M,), and what it lacks.

    The latter are anomalies. A cloud with neither points nor fields has columns without entries.

    Raise `RejectedMessageError`; see `point_cloud.decode`.
    """
    present = frozenset(point_cloud.field_names(cloud))
    named = present.intersection(vars(fields).values())
    wanted, missing = _wanted_fields(fields, time_since_epoch, named, expected)
    if not (present or cloud.width * cloud.height or len(cloud.data)):
        names = sent_columns.names_of(fields)
        return {what: np.zeros(0) for what in names if what not in expected.optional}, Counter()
    found = point_cloud.decode(cloud, dict(wanted.values()))
    # Converting a signalling NaN warns. Such a value is handled like any other NaN.
    with np.errstate(invalid="ignore"):
        columns = {what: found[name].astype(np.float64) for what, (name, _) in wanted.items()}
    return columns, Counter(missing)


@lru_cache(maxsize=64)
def _wanted_fields(
    fields: sensor.Fields, time_since_epoch: bool, present: frozenset[str], expected: Expected
) -> tuple[dict[str, tuple[str, Sequence[str]]], tuple[str, ...]]:
    """Return the name and the allowed types of the fields to read, by column, and the anomalies."""
    types: dict[str, Sequence[str]] = dict.fromkeys(WHOLE, NUMBERS)
    if time_since_epoch:
        types["time"] = DOUBLES
    names = sent_columns.names_of(fields)
    lacking = [what for what, name in names.items() if name not in present]
    wanted = {
        what: (name, types.get(what, point_cloud.FLOATS))
        for what, name in names.items()
        if what in expected.required or what not in lacking
    }
    unused = {"amplitude", *(what for what in expected.optional if names.get(what) == what)}
    return wanted, tuple(f"{w}_missing" for w in lacking if w not in wanted and w not in unused)


def require_frame(frame: str, own: SensorParameters) -> None:
    """Raise `RejectedMessageError` if a message is in another frame than its sensor's.

    Drivers that know no frames name none: their messages are in the sensor's.
    """
    if frame not in ("", own.frame):
        raise RejectedMessageError("frame", f"frame_id {quote(frame)}, must be {own.frame!r}")
