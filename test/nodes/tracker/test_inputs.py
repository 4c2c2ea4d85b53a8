"""How many clouds of a radar may wait while a scan is stepped."""

from dataclasses import replace

import pytest
from lone import lone

from phd_jdtc_ros.nodes.tracker.inputs import queue_depth


@pytest.mark.parametrize(
    ("rotation_s", "sectors", "depth"),
    [(0.0, 0, 50), (4.0, 32, 50), (1.0, 128, 128), (0.3, 32, 107)],
)
def test_queue_depth_wait_and_fifty_at_least(rotation_s, sectors, depth):
    radar = replace(lone().inputs[0], rotation_s=rotation_s, sectors=sectors)
    assert queue_depth(radar) == depth
