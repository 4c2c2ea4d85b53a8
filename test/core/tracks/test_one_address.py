"""One address, one track: with both engines, whatever aircraft and radars do."""

import numpy as np
import pytest
from hard_turns import PERIOD_S, scenes, seen, tracker
from runs import ENGINES

from phd_jdtc_ros.core.types import UNKNOWN
from phd_jdtc_ros.evaluation.accumulators.identity import IdentitySwitches
from phd_jdtc_ros.evaluation.comparison import LabelledPoints

CUTOFF = 1000.0


def answered(estimates):
    return estimates.attributes.address[estimates.attributes.address != UNKNOWN]


def switches_of(steps, truth):
    counted, label = IdentitySwitches(CUTOFF), np.arange(1, truth.shape[1] + 1)
    return sum(
        counted.add(LabelledPoints(label, position), LabelledPoints(found.track_id, found.position))
        for position, step in zip(truth, steps, strict=True)
        for found in step.filtered
    )


@pytest.mark.parametrize("engine", ENGINES)
def test_aircraft_that_leave_their_gates_have_one_track_each(engine):
    _, scans = scenes(11, 40)
    one = tracker(engine)
    for step in map(one.step, scans):
        for found in (*step.filtered, *step.smoothed):
            assert len(set(answered(found).tolist())) == len(answered(found))


@pytest.mark.parametrize("engine", ENGINES)
def test_addresses_make_no_more_switches_than_none(engine):
    with_addresses, without = (
        switches_of(map(tracker(engine, addresses).step, scans), truth)
        for addresses in (True, False)
        for truth, scans in [scenes(12, 40, addresses)]
    )
    assert with_addresses <= 0.1 * without


@pytest.mark.parametrize("engine", ENGINES)
def test_two_aircraft_with_one_address_far_apart_both_live(engine):
    rng = np.random.default_rng(13)
    one, found = tracker(engine), []
    velocity = np.array([[150.0, 20.0], [-120.0, 60.0]])
    for index in range(20):
        position = [[-3e4, 1e4], [2e4, -2e4]] + velocity * PERIOD_S * index
        exact = np.array([5.0, np.radians(0.01)])
        scan = seen(position, np.array([77, 77]), rng, (index + 1) * PERIOD_S, noise=exact)
        found += one.step(scan).filtered
        if index >= 8:
            apart = np.hypot(*(position[:, None] - found[-1].position[None]).T)
            assert apart.min(axis=0).max() < 500.0, index
    numbers = [set(estimates.track_id[estimates.attributes.address == 77]) for estimates in found]
    assert set.union(*numbers[8:]) == set(numbers[8])
    assert len(numbers[8]) == 2
