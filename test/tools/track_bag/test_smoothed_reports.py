"""Smoothed estimates of aircraft that report themselves, with a radar's sectors between reports."""

from pathlib import Path

import numpy as np

from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.evaluation.metrics import assign
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments
from phd_jdtc_ros.tools.track_bag import track_bag

BAG = Path(__file__).parents[3] / "bags" / "approach_adsb"
EQUIPPED = 16  # The first targets


def rms(estimates, truths):
    by_stamp, squares = {each.stamp_ns: each for each in estimates}, []
    for truth in truths[20:-10]:
        own = by_stamp.get(truth.stamp_ns)
        if own is not None:
            for target, row in zip(*assign(truth.position, own.position, 1000.0), strict=True):
                if truth.track_id[target] <= EQUIPPED:
                    squares.append(np.sum((own.position[row] - truth.position[target]) ** 2))
    assert len(squares) > 1000
    return np.sqrt(np.mean(squares))


def test_smoothed_aircraft_are_as_accurate_as_their_reports_allow(tmp_path):
    config = from_arguments.config_of(bag_parameters.read(BAG))
    record = track_bag(BagReader(BAG), config, tmp_path / "out", "approach").record()
    smoothed, filtered = (rms(each, record.truth) for each in (record.smoothed, record.filtered))
    # The radar's biases alone are 100 m.
    assert smoothed < filtered < 15.0
