"""Every message as an independent encoder and the middleware write it; stamps and identities."""

import importlib
import random
import re
import string
import struct
from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore
from samples import radar
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from msg_adapters.encoding import cdr, interfaces, stamps
from msg_adapters.incoming import detections as adapter
from phd_jdtc_ros.columns.identities import NONE, encode, read
from phd_jdtc_ros.core.types import UNKNOWN, Detections

STORE = get_typestore(Stores.ROS2_JAZZY)
PACKAGES = (
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_msgs",
    "visualization_msgs",
)
BITS = {"float": 0, "double": 0, **{f"{u}int{n}": n for u in ("", "u") for n in (8, 16, 32, 64)}}
CLASSES = [
    kind
    for package in PACKAGES
    for kind in vars(importlib.import_module(f"{package}.msg")).values()
    if hasattr(kind, "get_fields_and_field_types")
]
SECONDS = 1_000_000_000
LAYOUT = radar(
    amplitude_field="",
    height_field="height",
    position=(0.0, 0.0, 30.0),
    code_field="code",
    address_field="address",
)


def value_of(kind, rng):
    """Return a random value of a type, as rclpy names it."""
    if match := re.fullmatch(r"sequence<(.+?)(?:, (\d+))?>", kind):
        return [value_of(match[1], rng) for _ in range(rng.randrange(4))]
    if match := re.fullmatch(r"(.+)\[(\d+)\]", kind):
        return [value_of(match[1], rng) for _ in range(int(match[2]))]
    if kind.startswith("string"):
        return "".join(rng.choices(string.ascii_letters + "äß", k=rng.randrange(9)))
    if kind == "octet":
        return bytes([rng.randrange(256)])
    if kind == "boolean":
        return rng.random() < 0.5
    if kind not in BITS:
        package, name = kind.split("/")
        return filled(interfaces.message_class(f"{package}/msg/{name}"), rng)
    if kind in ("float", "double"):
        return rng.randrange(-(2**20), 2**20) / 8.0
    low = 0 if kind.startswith("u") else -(2 ** (BITS[kind] - 1))
    return rng.randrange(low, low + 2 ** BITS[kind])


def filled(kind, rng):
    """Return a message of random members."""
    types = kind.get_fields_and_field_types()
    return kind(**{name: value_of(text, rng) for name, text in types.items()})


@pytest.mark.parametrize("kind", CLASSES, ids=interfaces.type_name)
def test_encode_is_what_the_middleware_and_an_independent_encoder_have(kind):
    rng, name = random.Random(5), interfaces.type_name(kind)
    for message in (kind(), *(filled(kind, rng) for _ in range(20))):
        data = cdr.encode(message)
        assert deserialize_message(data, kind) == message
        if name in STORE.types:
            assert bytes(STORE.serialize_cdr(STORE.deserialize_cdr(data, name), name)) == data


def test_encode_takes_numbers_from_every_buffer():
    values = [1, 2, 255]
    buffers = (values, bytes(values), array("B", values), np.array(values, dtype=np.uint8))
    assert len({cdr.encode(PointCloud2(data=buffer)) for buffer in buffers}) == 1


def test_encode_refuses_wide_strings():
    class Wide(String):
        @classmethod
        def get_fields_and_field_types(cls):
            return {"data": "wstring"}

    with pytest.raises(TypeError, match="wide strings cannot be written"):
        cdr.encode(Wide())


@settings(deadline=None)
@given(st.integers(-(2**31) * SECONDS, 2**31 * SECONDS - 1))
def test_stamps_survive_the_message_to_the_nanosecond(stamp_ns):
    message = stamps.from_ns(stamp_ns)
    assert 0 <= message.nanosec < SECONDS
    assert stamps.to_ns(message) == stamp_ns


@pytest.mark.parametrize(("kind", "order"), [(b"\0\0", ">"), (b"\0\1", "<")])
@settings(deadline=None)
@given(st.integers(-(2**31), 2**31 - 1), st.integers(0, SECONDS - 1))
def test_of_cdr_reads_either_byte_order(kind, order, sec, nanosec):
    data = kind + b"\0\0" + struct.pack(order + "iI", sec, nanosec) + b"\0\0\0\0"
    assert stamps.of_cdr(data) == sec * SECONDS + nanosec


def found(**columns):
    return Detections(np.array([[5000.0, 0.1], [9000.0, -2.0]]), None, **columns)


def test_what_is_sent_comes_back():
    given = found(
        height=np.array([10_000.0, np.nan]),
        code=np.array([0o7700, UNKNOWN]),
        address=np.array([UNKNOWN, 0xABCDEF]),
    )
    cloud = adapter.to_msg(given, SECONDS, "radar_1", LAYOUT)
    report = adapter.from_msg(cloud, LAYOUT)
    assert_array_equal(report.detections.code, given.code)
    assert_array_equal(report.detections.address, given.address)
    assert_array_equal(report.detections.height, given.height)
    # On the way its first range is a slant range, twice that over ground.
    assert_allclose(report.detections.measurement, given.measurement, rtol=1e-6)
    assert report.anomalies == {"heights_unknown": 1}


@pytest.mark.parametrize(
    ("name", "value", "unusable"),
    [
        *(("code", none, 0) for none in (NONE, float(np.float32(NONE)), np.nan)),
        *(("code", bad, 1) for bad in (-1.0, 4096.0, 7.5, np.inf, -np.inf, 1e300)),
        *(("address", 0.0, 0), ("address", 2.0**24, 1), ("detection_type", 9.0, 0)),
    ],
)
def test_invalid_identity_is_unknown_and_counted_unless_flagged(name, value, unusable):
    read_ones, count = read({name: np.array([value, 1.0, 7.0])}, np.ones(3, dtype=bool))
    assert_array_equal(read_ones[name], [UNKNOWN, 1, 7])
    assert count == unusable
    least, _ = read({name: np.zeros(1)}, np.ones(1, dtype=bool))
    assert least[name] == (0 if name == "code" else UNKNOWN)


def test_identities_are_of_each_detection_that_is_left():
    kept = np.array([True, False, True])
    read_codes, unusable = read({"code": np.array([5.0, -3.0, 6.0]), "range": np.ones(3)}, kept)
    code = read_codes.pop("code")
    assert not read_codes
    assert_array_equal(code, [5, 6])
    assert unusable == 0
    given = found(height=np.array([1.0, 2.0]), code=np.array([3, 4]), address=np.array([5, 6]))
    part = given.take(np.array([1]))
    assert (part.height[0], part.code[0], part.address[0]) == (2.0, 4, 6)
    assert part.code.dtype == np.int64
    with pytest.raises(ValueError, match=r"code: expected shape \(2,\), got \(3,\)"):
        found(code=np.zeros(3, dtype=int))
    assert_array_equal(encode(None, 2), [NONE, NONE])
