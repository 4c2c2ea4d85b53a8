"""A bounded part of what the harness does without nodes, and its own parts."""

import argparse
import json
import random

import numpy as np
import pytest
from estimate_sets import estimates

from msg_adapters.encoding import interfaces, names, stamps
from robustness import command
from robustness.harness import figures, scans
from robustness.hostile_input import (
    asterix_bytes,
    asterix_recordings,
    bad_receivers,
    bags,
    decoders,
    forgeries,
    hostile,
    random_trackers,
    raw_bytes,
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


def test_the_matrix_has_all_parts_or_those_that_are_asked_for():
    def measured(part):
        return list(command.faults(argparse.Namespace(part=part)))

    every = measured(None)
    assert len(every) > 25
    assert every[-len(command.ELSEWHERE) - 1] is command.FAULTS[-1]
    assert measured(["overload"]) == [*command.figures_of("overload")]
    assert len(measured(["overload", "crowd"])) == 3


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


def test_messages_are_stamped_and_mutated_alone():
    before = interfaces.decode(scans.cloud(3, 0, scans.START_NS), names.CLOUD)
    after = interfaces.decode(scans.cloud(3, 0, 12_345_678_901), names.CLOUD)
    assert stamps.to_ns(after.header.stamp) == 12_345_678_901
    assert bytes(after.data) == bytes(before.data)
    rng = random.Random(0)
    data = scans.cloud(0, 0)
    made = [raw_bytes.mutate(data, rng) for _ in range(200)]
    assert all(message[raw_bytes.STAMP] == data[raw_bytes.STAMP] for message in made)
    assert sum(message != data for message in made) > 190


@pytest.mark.parametrize(
    ("measure", "reached"),
    [(lambda: ("fine", True, {}), True), (lambda: ("bad", False, {}), False)],
)
def test_figure_states_what_was_measured(measure, reached):
    figure = figures.measures("name", "goal")(measure)()
    assert figure.reached is reached
    assert figures.all_reached([figure]) is reached


def test_figures_have_goals_of_their_arguments_or_reasons():
    figure = figures.measures("name", lambda count=2: f"{count} scans")(
        lambda count: ("", True, {})
    )
    assert figure(count=3).goal == "3 scans"
    error = figures.NotMeasurableError("no root")
    figure = figures.measures("name", "goal")(raising(error))()
    assert (figure.measured, figure.reached, figure.reason) == (None, None, "no root")
    assert figures.all_reached([figure])


def raising(error):
    def measure():
        raise error

    return measure


@pytest.mark.parametrize("kind", [RuntimeError, IndexError, ValueError, OSError])
def test_figure_whose_measurement_fails_is_not_reached(kind):
    figure = figures.measures("name", "goal")(raising(kind("it died")))()
    assert figure.reached is False
    assert kind.__name__ in figure.measured
    assert "it died" in figure.measured


def test_summary_and_table_hold_every_figure(tmp_path):
    found = [figures.Figure("one", "goal", "1", True), *command.ELSEWHERE]
    path = command.write(found, tmp_path / "out", 1.0)
    summary = json.loads(path.read_text())
    assert [entry["figure"] for entry in summary["figures"]] == [f.name for f in found]
    assert summary["figures"][1]["measured"] is None
    assert summary["figures"][1]["reason"]
    assert command.table("faults", found).row_count == len(found)
