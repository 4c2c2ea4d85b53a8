import math
import struct

import numpy as np
import pytest
import transform_messages as tf_messages

from msg_adapters.encoding import RejectedMessageError
from msg_adapters.incoming import moving_radars
from msg_adapters.outgoing import map_layers
from phd_jdtc_ros.core.intake.transforms import Placement

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
PLACED = Placement((1.5, -2.0, 3.0), UPRIGHT)
STAMP = 5 * 10**9 + 7


def sent(parent="map", child="radar", stamp_ns=STAMP, placed=PLACED):
    return tf_messages.message((parent, child, stamp_ns, placed))


@pytest.mark.parametrize("little_endian", [True, False])
def test_transforms_are_those_that_another_implementation_wrote(little_endian):
    given = [
        ("map", "odom", STAMP, Placement((1.0, 2.0, 3.0), (0.0, 0.6, 0.0, -0.8))),
        ("odom", "a longer name \N{DEGREE SIGN}", 0, PLACED),
        ("a", "bc", 10**9, PLACED),
    ]
    data = tf_messages.message(*given, little_endian=little_endian)
    assert moving_radars.transforms_from_cdr(data, lambda frame: True) == given
    assert moving_radars.transforms_from_cdr(tf_messages.message(), lambda frame: True) == []


def test_own_static_frames_are_read_as_written():
    data = map_layers.frames_to_cdr([map_layers.Mounting("radar", (4.0, 5.0), 1.0)], STAMP, "map")
    ((parent, child, stamp_ns, placed),) = moving_radars.transforms_from_cdr(
        data, lambda frame: True
    )
    assert (parent, child, stamp_ns) == ("map", "radar", STAMP)
    assert placed.pose().position == (4.0, 5.0)
    assert placed.pose().yaw == pytest.approx(1.0)


def test_a_leading_slash_of_a_frame_means_nothing():
    ((parent, child, *_),) = moving_radars.transforms_from_cdr(
        sent("/map", "/radar"), lambda frame: True
    )
    assert (parent, child) == ("map", "radar")


def test_a_quaternion_that_is_nearly_of_norm_1_is_normalised():
    placed = Placement((0.0, 0.0, 0.0), (0.0, 0.0, 0.9, 1.2))
    ((*_, found),) = moving_radars.transforms_from_cdr(sent(placed=placed), lambda frame: True)
    assert found.rotation == pytest.approx((0.0, 0.0, 0.6, 0.8))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"placed": Placement((math.nan, 0.0, 0.0), UPRIGHT)}, "not_finite"),
        ({"placed": Placement((0.0, 0.0, 0.0), (0.0, math.inf, 0.0, 1.0))}, "not_finite"),
        ({"placed": Placement((0.0, 1e160, 0.0), UPRIGHT)}, "range"),
        ({"placed": Placement((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))}, "range"),
        ({"placed": Placement((0.0, 0.0, 0.0), (1e200, 0.0, 0.0, 1e200))}, "range"),
        ({"parent": ""}, "frame"),
        ({"child": "/"}, "frame"),
        ({"parent": "/radar"}, "frame"),
        ({"parent": "x" * 300}, "frame"),
        ({"stamp_ns": -(10**9)}, "schema"),
    ],
)
def test_unusable_transforms_are_refused_and_those_of_other_frames_left_out(changes, reason):
    sound = ("map", "robot", STAMP, PLACED)
    given = {"parent": "map", "child": "radar", "stamp_ns": STAMP, "placed": PLACED, **changes}
    data = tf_messages.message(tuple(given.values()), sound)
    with pytest.raises(RejectedMessageError) as caught:
        moving_radars.transforms_from_cdr(data, lambda frame: True)
    assert caught.value.reason == reason
    assert moving_radars.transforms_from_cdr(data, lambda frame: frame == "robot") == [sound]


def test_damaged_bytes_are_refused_or_read_and_nothing_else():
    whole, rng = sent(), np.random.default_rng(1)
    damaged = [whole[:end] for end in range(len(whole))]
    damaged += [whole[:4] + struct.pack("<I", 2**32 - 1) + whole[8:]]
    for _ in range(2000):
        data = bytearray(whole)
        for place in rng.integers(0, len(data), 3):
            data[place] = rng.integers(256)
        damaged.append(bytes(data))
    refused = 0
    for data in damaged:
        try:
            moving_radars.transforms_from_cdr(data, lambda frame: True)
        except RejectedMessageError:
            refused += 1
    assert refused >= len(whole)
