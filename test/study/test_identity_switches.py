"""Identities cause no extra switches in the scenes of the study whose plots have some."""

from dataclasses import replace
from pathlib import Path

import pytest

from phd_jdtc_ros.study import monte_carlo
from phd_jdtc_ros.study.monte_carlo.metrics import VALUES
from phd_jdtc_ros.study.monte_carlo.tasks import perform
from phd_jdtc_ros.tools.monte_carlo import load_study

ROOT = Path(__file__).parents[2]
# The aircraft that join are apart again after 190 s.
SEED, LONGEST_S = 0, {"terminal radar, clean codes": 100}
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
