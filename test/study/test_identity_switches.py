"""Identities cause no extra switches, in any shipped scene whose plots have some."""

from dataclasses import replace
from pathlib import Path

import pytest

from msg_adapters import interfaces, names, truth
from msg_adapters.readers import reader_of
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.evaluation.accumulators.identity import IdentitySwitches
from phd_jdtc_ros.evaluation.comparison import LabelledPoints
from phd_jdtc_ros.parameter_files import bag_parameters, tracker_params
from phd_jdtc_ros.study import monte_carlo
from phd_jdtc_ros.study.monte_carlo.metrics import VALUES
from phd_jdtc_ros.study.monte_carlo.tasks import perform
from phd_jdtc_ros.tools.monte_carlo import load_study

ROOT = Path(__file__).parents[2]
# Seed 0 is that of the shipped bags. The aircraft that join are apart again after 190 s.
SEED, LONGEST_S = 0, {"terminal radar, clean codes": 100, "two_approach_radars": 60}
CUTOFF, KINDS = 1000.0, ("code", "address")
STUDY = load_study(ROOT / "config" / "studies" / "published.yaml", {})
GOALS = [goal for goal in STUDY.goals if goal.name.endswith("against none")]


def switches(scores, goal):
    """Return the switches of a run's filtered estimates."""
    assert scores.lags[0] == 0
    return scores.values[0, :, 0, VALUES.index(goal.figure)].sum()


def test_every_kind_of_identity_is_compared_with_none():
    assert {goal.case for goal in GOALS} == {"joining aircraft", "terminal radar, clean codes"}


@pytest.mark.parametrize("goal", GOALS, ids=lambda goal: goal.case)
def test_identities_make_no_more_switches_than_none(goal):
    of_goal = STUDY.select([goal.case], [goal.variant, goal.relative_to])
    (case,) = of_goal.cases
    scans = min(case.scenario.scans, LONGEST_S.get(goal.case, case.scenario.scans))
    begun = [flight for flight in case.scenario.targets if flight.start_s < scans - 1]
    shorter = replace(case.scenario, scans=scans, targets=tuple(begun))
    case = replace(case, scenario=shorter, lags=(0,))
    found = {}
    for task in monte_carlo.plan(replace(of_goal, cases=(case,)), [SEED]).tasks:
        outcome = perform(task)
        assert outcome.error == ""
        found.update(outcome.scores)
    own, none = (switches(found[name], goal) for name in (goal.variant, goal.relative_to))
    assert own <= none


def identity_fields(bag):
    """Return the parameters that name the identities of a bag's plots."""
    given = bag_parameters.read(bag) or {}
    fields = [f"{radar}.fields.{kind}" for radar in given.get("sensors", []) for kind in KINDS]
    return [name for name in fields if given.get(name)]


BAGS = [path for path in sorted((ROOT / "bags").glob("*/")) if identity_fields(path)]


def test_shipped_bags_have_identities():
    assert [path.name for path in BAGS] == ["two_approach_radars"]


def switches_of_bag(path, left_out):
    """Return the identity switches of filtered estimates of a bag's first part, and their stamps.

    Of the bag's parameters those that are left out are empty.
    """
    bag = BagReader(path)
    config = tracker_params.config({**bag_parameters.read(path), **dict.fromkeys(left_out, "")})
    by_topic = {radar.topic: index for index, radar in enumerate(config.inputs)}
    pipeline, true, found, begin_ns = new_pipeline(config), {}, [], None
    for entry in bag.messages([names.TRUTH, *by_topic]):
        begin_ns = begin_ns or entry.log_time_ns
        if entry.log_time_ns > begin_ns + LONGEST_S[path.name] * 10**9:
            break
        if entry.topic == names.TRUTH:
            targets = truth.from_msg(interfaces.decode(entry.data, names.CLOUD))
            true[targets.stamp_ns] = targets
            continue
        index = by_topic[entry.topic]
        report = reader_of(config.inputs[index]).from_cdr(entry.data, config.inputs[index])
        events = pipeline.add(index, report.stamp_ns, report.detections, report.sector)
        found += [each for event in events for each in event.step.filtered]
    counter = IdentitySwitches(CUTOFF)
    common = [each for each in found if each.stamp_ns in true]
    count = sum(
        counter.add(
            LabelledPoints(true[each.stamp_ns].track_id, true[each.stamp_ns].position),
            LabelledPoints(each.track_id, each.position),
        )
        for each in common
    )
    return count, len(common)


@pytest.mark.parametrize("path", BAGS, ids=lambda path: path.name)
def test_identities_in_a_bag_make_no_more_switches_than_none(path):
    (own, stamps), (none, _) = (switches_of_bag(path, out) for out in ([], identity_fields(path)))
    assert stamps >= 10
    assert own <= none
