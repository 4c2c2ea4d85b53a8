"""Every message is written as an independent encoder and the middleware have it."""

import importlib
import random
import re
import string
from array import array

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from msg_adapters.encoding import cdr, interfaces

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
