import numpy as np
import pytest

from phd_jdtc_ros.core.conflicts.model import PAIR, Conflicts
from phd_jdtc_ros.core.conflicts.watch import ACKNOWLEDGED, ALARM, NONE, Alarms

SECOND = 10**9


def conflicts(seconds, probabilities):
    """Return conflicts of pairs by their second track, with these probabilities."""
    count = len(probabilities)
    unknown = np.zeros(count)
    return Conflicts(
        stamp_ns=1000 * SECOND + round(seconds * SECOND),
        kind=np.full(count, PAIR),
        first=np.ones(count, dtype=np.int64),
        second=np.array([*probabilities], dtype=np.int64),
        probability=np.array([*probabilities.values()], dtype=float),
        time_s=unknown,
        cpa=unknown,
        tcpa_s=unknown,
        ahead=unknown,
        starboard=unknown,
        place=np.zeros((count, 2)),
        alarm=np.zeros(count, dtype=np.int64),
    )


def test_alarm_stays_until_the_odds_have_fallen_far_below_the_threshold():
    alarms, states = Alarms(per_hour=6.0), []
    for second, probability in enumerate((0.05, 0.12, 0.08, 0.03, 0.02, 0.12)):
        found, _ = alarms.add(conflicts(second, {2: probability}))
        states.append(found.alarm[0])
    # A quarter of the odds of 0.1 is a probability of 0.027.
    assert states == [NONE, ALARM, ALARM, ALARM, NONE, ALARM]


def test_alarm_is_told_once():
    alarms = Alarms(per_hour=6.0)
    new = [alarms.add(conflicts(second, {2: 0.95}))[1] for second in range(5)]
    assert new == [[0], [], [], [], []]


def test_acknowledged_alarm_stays_acknowledged_and_a_new_one_is_not():
    alarms = Alarms(per_hour=6.0)
    alarms.add(conflicts(0.0, {2: 0.95}))
    assert alarms.acknowledge() == 1
    assert alarms.acknowledge() == 0
    found, _ = alarms.add(conflicts(1.0, {2: 0.96, 3: 0.97}))
    assert found.alarm.tolist() == [ACKNOWLEDGED, ALARM]
    assert alarms.fresh == 1


def test_alarm_returns_after_its_conflict_has_ended():
    alarms = Alarms(per_hour=6.0, kept_s=30.0)
    alarms.add(conflicts(0.0, {2: 0.95}))
    alarms.acknowledge()
    alarms.add(conflicts(20.0, {}))
    assert alarms.add(conflicts(25.0, {2: 0.95}))[0].alarm.tolist() == [ACKNOWLEDGED]
    alarms.add(conflicts(60.0, {}))
    assert alarms.add(conflicts(61.0, {2: 0.95}))[0].alarm.tolist() == [ALARM]


@pytest.mark.parametrize("per_hour", [2.0, 6.0, 20.0])
def test_threshold_keeps_to_the_rate_with_the_largest_probabilities(per_hour):
    rng, alarms, raised = np.random.default_rng(3), Alarms(per_hour=per_hour), []
    hours, every_s = 6, 60
    for k in range(hours * 3600 // every_s):
        # Each conflict is another pair's, and lasts for one report.
        found, new = alarms.add(conflicts(k * every_s, {k + 2: rng.uniform(0.05, 0.85)}))
        raised += [found.probability[row] for row in new]
    # One alarm more an hour is from the moment at which the threshold is chosen.
    assert per_hour * hours * 0.5 < len(raised) <= (per_hour + 1.0) * hours + 3
    assert np.median(raised) > 0.85 - 1.2 * per_hour / 60.0


def test_nearly_certain_conflicts_are_never_kept_back():
    alarms = Alarms(per_hour=1.0)
    for k in range(20):
        _, new = alarms.add(conflicts(k, {k + 2: 0.97}))
        assert new == [0]


def test_improbable_conflicts_are_no_alarm_in_a_quiet_hour():
    alarms = Alarms(per_hour=1000.0)
    for k in range(20):
        _, new = alarms.add(conflicts(k * 60.0, {k + 2: 0.08}))
        assert not new
