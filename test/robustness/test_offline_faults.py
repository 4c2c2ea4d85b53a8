"""A bounded part of what the harness does without nodes, and its own parts."""

import numpy as np
import pytest
from estimate_sets import estimates

from robustness.hostile_input import (
    asterix_bytes,
    asterix_recordings,
    bad_receivers,
    bags,
    decoders,
    forgeries,
    hostile,
    random_trackers,
)
from robustness.reports import absurd, crowd, numerics, reflected

# Scans of a case of `numerics`; the gap of an hour is behind the fortieth.
SCANS = {**dict.fromkeys(numerics.CASES, 20), "an hour's gap": 45}


@pytest.mark.parametrize(
    ("measure", "bounds"),
    [
        (bags.measure_recovery, (100,)),
        (bags.measure_bomb, ()),
        (absurd.measure, (3,)),
        (hostile.measure_names, ()),
        (hostile.measure_forged_times, ()),
        (asterix_bytes.measure, (300,)),
        (bad_receivers.measure, (600,)),
        (bad_receivers.measure_receivers, ()),
        (asterix_recordings.measure_blocks, (60,)),
        (asterix_recordings.measure_captures, ()),
        (decoders.measure, (200,)),
        (decoders.measure_bags, (60,)),
        (random_trackers.measure, (12,)),
    ],
    ids=[
        *(
            "recovered bags",
            "a bomb",
            "absurd numbers",
            "long lists of names",
            "forged times of a capture",
        ),
        *("hostile ASTERIX", "hostile AIS and ADS-B", "bad receivers"),
        *("damaged blocks", "damaged captures"),
        *("random clouds", "damaged bags", "random trackers"),
    ],
)
def test_fault_outside_an_engine_reaches_its_goal(measure, bounds):
    figure = measure(*bounds)
    assert figure.reached, (figure.measured, figure.details)


@pytest.mark.parametrize(
    ("measure", "bounds"),
    [
        (crowd.measure, {"detections": 10_000, "seeds": 1, "kinds": ["equal"]}),
        (absurd.measure_radar, {"every": 3}),
        (absurd.measure_in_space, {"every": 5}),
        (hostile.measure_repeated, {}),
        (forgeries.measure, {}),
        (reflected.measure, {"cases": ["parked, once by 1 km", "in the air, once by 1 km"]}),
    ],
    ids=[
        *("crowd", "absurd numbers", "absurd numbers in space", "a repeated buffer"),
        *("forged checkpoints", "a reflected reply"),
    ],
)
def test_fault_in_the_engine_reaches_its_goal(measure, bounds):
    figure = measure(**bounds)
    assert figure.reached, (figure.measured, figure.details)


@pytest.mark.parametrize("case", numerics.CASES)
def test_no_covariance_that_is_none_leaves_the_engine(case):
    whole = numerics.CASES[case]
    begun = numerics.Case(lambda config: whole.scans(config)[: SCANS[case]], whole.values)
    assert numerics.outcome(begun) == ""


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda matrix: matrix, ""),
        (lambda matrix: matrix * np.nan, "covariance is not finite"),
        (lambda matrix: -matrix, "a variance is not positive"),
        (lambda matrix: 0.0 * matrix, "a variance is not positive"),
        (lambda matrix: matrix + np.triu(matrix + 1.0, 1), "a covariance is not symmetric"),
        (lambda matrix: matrix - 0.9 * (1.0 - matrix), "a covariance has a negative eigenvalue"),
    ],
)
def test_faults_of_covariances_are_seen(change, said):
    found = numerics.fault_of(estimates(np.zeros((1, 5)), change(np.eye(5))), 1e-12)
    assert found.startswith(said) if said else found == ""
