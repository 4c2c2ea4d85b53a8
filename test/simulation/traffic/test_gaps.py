import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.simulation.scenario import Scenario
from phd_jdtc_ros.simulation.traffic import gaps
from phd_jdtc_ros.simulation.traffic.flight import Flight, Leg
from phd_jdtc_ros.simulation.traffic.gaps import Gap
from studies.runner import until


def flight(speed, length_s, start_s=100.0):
    return Flight(0, 1e3, start_s, (0.0, 0.0), (speed, 0.0), (Leg(length_s),))


FLIGHTS = [flight(200.0, 900.0), flight(5.0, 3000.0), flight(150.0, 80.0), flight(100.0, 1800.0)]
GIVEN = {"count": 2, "shortest_s": 10.0, "longest_s": 120.0, "seed": 3}


def drawn(**changes):
    faults = []
    found = gaps.of_targets({"gaps": {**GIVEN, **changes}}, FLIGHTS, faults)
    return found, faults


def test_gaps_are_of_fast_targets_that_are_there_before_and_after():
    for seed in range(20):
        found, faults = drawn(seed=seed)
        assert not faults
        # None for one that taxis, and for one that is there for too short a time.
        assert sorted(gap.number for gap in found) == [1, 4]
        for gap in found:
            own = FLIGHTS[gap.number - 1]
            assert 10.0 <= gap.end_s - gap.start_s <= 120.0
            assert own.start_s + 60.0 <= gap.start_s
            assert gap.end_s <= own.end_s - 60.0 + 1e-9


def test_gaps_are_those_of_a_seed_that_fit():
    assert drawn() == drawn()
    assert drawn()[0] != drawn(seed=4)[0]
    assert len(drawn(count=10)[0]) == 2
    faults = []
    assert gaps.of_targets({"gaps": GIVEN}, [], faults) == ()
    assert not faults


def test_target_is_hidden_in_its_own_gaps_in_any_part_of_the_run():
    known = [Gap(1, 5.0, 6.0), Gap(2, 0.0, 9.0), Gap(1, 7.0, 8.0)]
    out = gaps.in_gap(known, 1, np.array([4.9, 5.0, 6.0, 7.5, 8.5]))
    assert out.tolist() == [False, True, False, True, False]
    targets = (flight(200.0, 900.0, 700.0), flight(150.0, 900.0, 10.0), flight(100.0, 900.0))
    known = (Gap(1, 800.0, 850.0), Gap(2, 80.0, 90.0), Gap(3, 200.0, 220.0))
    radars = resolve({}).model.radars
    part = until(Scenario(1, 1.0, 3601, targets, radars, gaps=known), 500.0)
    assert part.targets == targets[1:]
    assert part.gaps == (Gap(1, 80.0, 90.0), Gap(2, 200.0, 220.0))


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"count": -1}, "gaps.count: -1 given"),
        ({"other": 1}, "gaps.other: unknown key"),
        ({"longest_s": 5.0}, "gaps.longest_s: 5 given, must be at least shortest_s, 10"),
    ],
)
def test_gaps_name_what_is_wrong(changes, fault):
    found, faults = drawn(**changes)
    assert found == ()
    assert faults[0].startswith(fault)
