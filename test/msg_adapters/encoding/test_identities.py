"""Codes, addresses and heights of detections, from clouds and back."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from samples import radar

from msg_adapters.encoding.identities import ADDRESSES, CODES, NONE, encode, read
from msg_adapters.incoming import detections as adapter
from phd_jdtc_ros.core.types import UNKNOWN, Detections

LAYOUT = radar(
    amplitude_field="",
    height_field="height",
    position=(0.0, 0.0, 30.0),
    code_field="code",
    address_field="address",
)


def found(**columns):
    return Detections(np.array([[5000.0, 0.1], [9000.0, -2.0]]), None, **columns)


def test_what_is_sent_comes_back():
    given = found(
        height=np.array([10_000.0, np.nan]),
        code=np.array([0o7700, UNKNOWN]),
        address=np.array([UNKNOWN, 0xABCDEF]),
    )
    cloud = adapter.to_msg(given, 0, "radar_1", LAYOUT)
    report = adapter.from_msg(cloud, LAYOUT)
    assert_array_equal(report.detections.code, given.code)
    assert_array_equal(report.detections.address, given.address)
    assert_array_equal(report.detections.height, given.height)
    # On the way its first range is a slant range, twice that over ground.
    assert_allclose(report.detections.measurement, given.measurement, rtol=1e-6)
    assert report.anomalies == {"heights_unknown": 1}


@pytest.mark.parametrize(
    ("kind", "value", "unusable"),
    [
        *((CODES, none, 0) for none in (NONE, float(np.float32(NONE)), np.nan)),
        *((CODES, bad, 1) for bad in (-1.0, 4096.0, 7.5, np.inf, -np.inf, 1e300)),
        *((ADDRESSES, 0.0, 0), (ADDRESSES, 2.0**24, 1)),
    ],
)
def test_invalid_identity_is_unknown_and_counted_unless_flagged(kind, value, unusable):
    found, count = read(np.array([value, 1.0, 4095.0]), np.ones(3, dtype=bool), kind)
    assert_array_equal(found, [UNKNOWN, 1, 4095])
    assert count == unusable
    least, _ = read(np.zeros(1), np.ones(1, dtype=bool), kind)
    assert least == (0 if kind is CODES else UNKNOWN)


def test_identities_are_of_each_detection_that_is_left():
    code, unusable = read(np.array([5.0, -3.0, 6.0]), np.array([True, False, True]), CODES)
    assert_array_equal(code, [5, 6])
    assert unusable == 0
    given = found(height=np.array([1.0, 2.0]), code=np.array([3, 4]), address=np.array([5, 6]))
    part = given.take(np.array([1]))
    assert (part.height[0], part.code[0], part.address[0]) == (2.0, 4, 6)
    assert part.code.dtype == np.int64
    with pytest.raises(ValueError, match=r"code: expected shape \(2,\), got \(3,\)"):
        found(code=np.zeros(3, dtype=int))
    assert_array_equal(encode(None, 2), [NONE, NONE])
