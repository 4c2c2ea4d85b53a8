"""A bounded part of what the harness does without nodes, and its own parts."""

import argparse
import json
import random
import unittest.mock
from collections import Counter

import numpy as np
import pytest
from estimate_sets import estimates

from msg_adapters.encoding import interfaces, names, stamps
from robustness import command
from robustness.harness import engines, figures, scans
from robustness.hostile_input import (
    asterix_bytes,
    asterix_recordings,
    bags,
    decoders,
    forgeries,
    hostile,
    random_trackers,
    raw_bytes,
)
from robustness.reports import absurd, crowd, numerics, reflected

# Fewer particles than a user has: what is tested is their numbers' range.
FEW = {"particles_per_target": 200, "particles_per_birth": 256}
# Scans of a case of `numerics`; the gap of an hour is behind the fortieth.
SCANS = {**dict.fromkeys(numerics.CASES, 20), "an hour's gap": 45}
every_engine = pytest.mark.parametrize("engine", engines.ALL)


@pytest.mark.parametrize(
    ("measure", "bounds"),
    [
        (bags.measure_recovery, (100,)),
        (bags.measure_bomb, ()),
        (absurd.measure, (3,)),
        (hostile.measure_names, ()),
        (hostile.measure_forged_times, ()),
        (asterix_bytes.measure, (300,)),
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
        *("hostile ASTERIX", "damaged blocks", "damaged captures"),
        *("random clouds", "damaged bags", "random trackers"),
    ],
)
def test_fault_outside_an_engine_reaches_its_goal(measure, bounds):
    figure = measure(*bounds)
    assert figure.reached, (figure.measured, figure.details)


@every_engine
@pytest.mark.parametrize(
    ("measure", "bounds"),
    [
        # Two kinds of detections with particles: with either corrector one.
        (crowd.measure, {"detections": 10_000, "seeds": 1, "every": 3}),
        (absurd.measure_radar, {"every": 3, **FEW}),
        (hostile.measure_repeated, {}),
        (forgeries.measure, FEW),
        (reflected.measure, {"cases": ["parked, once by 1 km", "in the air, once by 1 km"]}),
    ],
    ids=["crowd", "absurd numbers", "a repeated buffer", "forged checkpoints", "a reflected reply"],
)
def test_fault_in_an_engine_reaches_its_goal(measure, bounds, engine):
    with engines.using(engine):
        figure = measure(**bounds)
    assert figure.reached, (figure.measured, figure.details)


@every_engine
@pytest.mark.parametrize("case", numerics.CASES)
def test_no_covariance_that_is_none_leaves_an_engine(case, engine):
    whole = numerics.CASES[case]
    begun = numerics.Case(
        lambda config: whole.scans(config)[: SCANS[case]], {**FEW, **whole.values}
    )
    assert numerics.outcome(begun, engine) == ""


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


def test_figure_is_named_after_its_engine_which_the_measurement_sees():
    def measure():
        return figures.Figure("crowd", "goal", engines.current(), True)

    found = engines.of(engines.GAUSSIAN, measure)()
    assert (found.name, found.measured) == ("gaussian: crowd", "gaussian")
    assert engines.current() == engines.PARTICLES
    allowed = "'kalman' given, must be one of particles, gaussian"
    with pytest.raises(ValueError, match=allowed), engines.using("kalman"):
        pass


def named(arguments):
    """Return how many measurements of each engine a command makes, none of which is done."""
    begun = []
    with unittest.mock.patch.object(engines, "of", lambda engine, _: begun.append(engine)):
        list(command.faults(argparse.Namespace(**{"part": None, **arguments})))
    return Counter(begun)


def test_faults_are_of_both_engines_unless_one_is_asked_for():
    every = len(command.FAULTS)
    of_engines = sum(measure.__dict__["of_engines"] for measure in command.FAULTS)
    assert 10 < of_engines < every
    assert named({"engine": "particles", "only": False}) == {
        "particles": every,
        "gaussian": of_engines,
    }
    assert named({"engine": "gaussian", "only": True}) == {"gaussian": every}
    # Two of overload, with each engine.
    alone = named({"engine": "particles", "only": False, "part": ["overload"]})
    assert alone == {"particles": 2, "gaussian": 2}


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
