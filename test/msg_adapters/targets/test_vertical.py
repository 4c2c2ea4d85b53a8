from dataclasses import replace

import numpy as np
from samples import estimates

from msg_adapters.targets import markers, vertical
from phd_jdtc_ros.core.types import UNKNOWN, Attributes


def known(height, code, address):
    """Return two estimates, the first with these attributes and the second with none."""
    sample = estimates(2)
    count = len(sample)
    heights = np.full((count, 2), np.nan)
    heights[0] = height, 0.0
    codes, addresses = np.full(count, UNKNOWN), np.full(count, UNKNOWN)
    codes[0], addresses[0] = code, address
    spread = np.where(np.isnan(heights)[:, :, None], np.nan, np.eye(2))
    return replace(sample, attributes=Attributes(heights, spread, codes, addresses))


def test_words_are_flight_level_and_identity():
    assert vertical.words(known(3048.0, 0o7700, 0x3C6444))[:2] == ["FL100 7700", ""]
    assert vertical.words(known(3048.0, UNKNOWN, 0x3C6444))[0] == "FL100 3C6444"
    assert vertical.words(known(3048.0, UNKNOWN, UNKNOWN), 304.8)[0] == "FL110"
    assert vertical.words(known(-304.8, 0, UNKNOWN))[0] == "FL-10 0000"
    assert vertical.words(known(np.nan, 0o0021, UNKNOWN))[0] == "0021"
    assert vertical.words(estimates(2)) == [""] * len(estimates(2))
    found = known(3048.0, 0o7700, UNKNOWN)
    assert vertical.words(found, 152.4)[0] == "FL105 7700"
    assert b" FL105 7700" in markers.to_cdr(found, "map", ("one", "two"), 152.4)
    found = vertical.of(known(3048.0, UNKNOWN, UNKNOWN))
    assert found.known.tolist()[:2] == [True, False]
    assert found.state[:2].tolist() == [[3048.0, 0.0], [0.0, 0.0]]
    assert not found.covariance[1].any()
    assert not vertical.of(estimates(2)).known.any()
