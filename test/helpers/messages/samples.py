"""Values and messages that several test modules share."""

import struct
from array import array
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from msg_adapters.encoding import stamps
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.core.types import UNKNOWN, Attributes, Detections, Estimates, Truth

STAMP_NS = 1_700_000_000_123_456_789
FRAME = "radar_1"
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8}
CODES = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}


def cloud(
    named, points, *, big_endian=False, height=1, row_padding=0, point_padding=0, frame=FRAME
):
    """Return a cloud packed with `struct`, independent of the code under test.

    `named` are (name, datatype) pairs in order, `points` rows of numbers.
    """
    order = ">" if big_endian else "<"
    layout = order + "".join(CODES[datatype] for _, datatype in named)
    offsets = np.cumsum([0, *(SIZES[datatype] for _, datatype in named)])
    packed = [struct.pack(layout, *point) + b"\xa5" * point_padding for point in points]
    width = len(packed) // height
    rows = [
        b"".join(packed[row * width : (row + 1) * width]) + b"\x5a" * row_padding
        for row in range(height)
    ]
    step = int(offsets[-1]) + point_padding
    return PointCloud2(
        header=Header(stamp=stamps.from_ns(STAMP_NS), frame_id=frame),
        height=height,
        width=width,
        fields=[
            PointField(name=name, offset=int(offset), datatype=datatype, count=1)
            for (name, datatype), offset in zip(named, offsets, strict=False)
        ],
        is_bigendian=big_endian,
        point_step=step,
        row_step=step * width + row_padding,
        data=b"".join(rows),
        is_dense=True,
    )


# Two words of `Units`, each with its key, for false and true.
FLAGS = {
    "compass": ("azimuth_convention", ("enu_ccw", "compass_cw")),
    "azimuth_in_degrees": ("azimuth", ("rad", "deg")),
    "amplitude_in_db": ("amplitude", ("linear", "db")),
    "time_since_epoch": ("time_reference", ("stamp", "epoch")),
}


def layout(usual, **changes):
    """Return how a radar's clouds are read, with changes; ``X_field`` names a quantity's field.

    ``X_unit`` is a quantity's unit, and the keys of `FLAGS` are true or false.
    """
    units = {key: changes.pop(key) for key in [*changes] if key.endswith("_unit")}
    units = {key.removesuffix("_unit"): word for key, word in units.items()}
    units |= {
        key: words[bool(changes.pop(flag))]
        for flag, (key, words) in FLAGS.items()
        if flag in changes
    }
    named = {key: changes.pop(key) for key in [*changes] if key.endswith("_field")}
    fields_of = {key.removesuffix("_field"): name for key, name in named.items()}
    given = replace(usual, fields=replace(usual.fields, **fields_of), **changes)
    return replace(given, units=replace(usual.units, **units))


def radar(**changes):
    """Return how the reference radar's clouds are read, with some of it changed."""
    usual = RadarParameters(name="radar_1", topic="/radar_1/detections", frame=FRAME)
    return layout(usual, **changes)


def polar(points, datatype=PointField.FLOAT32, names=("range", "azimuth", "amplitude"), **layout):
    """Return a cloud of (range, azimuth, amplitude) rows."""
    return cloud([(name, datatype) for name in names], points, **layout)


def detections():
    """Return three detections whose numbers are exact in float32."""
    measurement = np.array([[1024.5, 0.25], [16999.0, -3.125], [0.0, 3.0]])
    return Detections(measurement, np.array([3.75, 250.0, 1e6]))


def truth(count=2):
    """Return targets whose numbers are exact in float32."""
    state = np.arange(5.0 * count).reshape(count, 5) * 0.25 - 1.0
    state[:, 4] = 0.0
    return Truth(STAMP_NS, state, np.arange(1, count + 1), np.arange(count) % 2)


def estimates(count=3, classes=2, lag=5):
    """Return estimates with a positive definite covariance and numbers exact in float32."""
    rng = np.random.default_rng(1)
    half = rng.integers(-8, 8, (count, 5, 5)).astype(float)
    share = rng.integers(1, 8, (count, classes)) / 8.0
    return Estimates(
        stamp_ns=STAMP_NS,
        lag=lag,
        state=rng.integers(-40_000, 40_000, (count, 5)) * 0.25,
        covariance=half @ half.transpose(0, 2, 1) + 16.0 * np.eye(5),
        weight=rng.integers(1, 16, count) / 8.0,
        class_probability=share,
        class_id=np.arange(count) % classes,
        track_id=np.arange(count) * 1000,
    )


def many_estimates(count):
    """Return estimates of random numbers, with no tracks."""
    rng = np.random.default_rng(count)
    root = rng.standard_normal((count, 5, 5))
    probability = rng.dirichlet([0.3, 0.3], count)
    return Estimates(
        stamp_ns=1_500_000_007,
        lag=0,
        state=100.0 * rng.standard_normal((count, 5)),
        covariance=100.0 * root @ root.transpose(0, 2, 1),
        weight=np.ones(count),
        class_probability=probability,
        class_id=probability.argmax(axis=1),
        track_id=np.zeros(count, dtype=int),
    )


def as_sent(message):
    """Return a message as received: with colours of single precision, for example."""
    return deserialize_message(serialize_message(message), type(message))


def nothing(classes=2):
    """Return an empty set of estimates."""
    return estimates(0, classes, lag=0)


def plain(value):
    """Return a message of rclpy or of rosbags as nested dicts, lists and numbers."""
    if is_dataclass(value):
        # Beside the fields, rosbags keeps constants and the type.
        names = [field.name for field in fields(value) if field.name.islower()]
        names = [name for name in names if name != "__msgtype__"]
        return {name: plain(getattr(value, name)) for name in names}
    if hasattr(value, "get_fields_and_field_types"):
        return {n: plain(getattr(value, n)) for n in value.get_fields_and_field_types()}
    if isinstance(value, bytes):  # The diagnostic level
        return value[0]
    if isinstance(value, (list, tuple, np.ndarray, array)):
        return [plain(element) for element in value]
    return value


def with_heights(given, heights):
    """Return estimates with heights and climb rates, NaN where unknown, and no identities."""
    height = np.array(heights, dtype=float).reshape(-1, 2)
    covariance = np.where(np.isnan(height[:, :1, None]), np.nan, np.diag([60.0, 1.5]))
    none = np.full(len(given), UNKNOWN)
    return replace(given, attributes=Attributes(height, covariance, none, none))


of_every_kind = pytest.mark.parametrize(
    "found",
    [
        *(nothing(), estimates(), many_estimates(1), many_estimates(40)),
        replace(estimates(2), class_id=np.array([1, 1])),
        with_heights(estimates(3), [[3048.0, -5.0], [np.nan, np.nan], [900.0, 0.0]]),
    ],
    ids=["none", "samples", "one", "many", "one_class", "heights"],
)
