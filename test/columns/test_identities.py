"""Codes and addresses of detections in messages and tables."""

import numpy as np

from phd_jdtc_ros.columns import identities
from phd_jdtc_ros.core.types import UNKNOWN


def test_addresses_of_zeros_or_of_ones_are_nobodys():
    column = np.array([0.0, 0xFFFFFF, 0x4B1234])
    found, impossible = identities.read({"address": column}, np.ones(3, dtype=np.bool_))
    assert found["address"].tolist() == [UNKNOWN, UNKNOWN, 0x4B1234]
    assert impossible == 0
