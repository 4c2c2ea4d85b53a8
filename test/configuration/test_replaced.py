"""A parameter of before is refused with what takes its place, by every node."""

import pytest

from phd_jdtc_ros.asterix_bridge import settings as bridge
from phd_jdtc_ros.configuration import replaced, tracker_node
from phd_jdtc_ros.configuration.schema import ConfigError, check
from phd_jdtc_ros.handover import settings as hand_over
from phd_jdtc_ros.parameter_files import evaluator, sensor_replay

REGIONS = {
    "trackers": ["west", "east"],
    "west.region": [-1.0, 0.0, 0.0, 1.0, 0.1],
    "east.region": [0.0, 0.0, 1.0, 1.0, 0.1],
}


def faults_of(resolve, given):
    with pytest.raises(ConfigError) as caught:
        resolve(given)
    return list(caught.value.faults)


def refused(table, prefix=""):
    return [f"{prefix}{name}: no longer a parameter, {now}" for name, now in table.items()]


@pytest.mark.parametrize(
    ("parameters", "table"),
    [(evaluator.TABLE, replaced.EVALUATOR), (sensor_replay.AT_THE_START, replaced.REPLAY)],
    ids=["evaluator", "sensor_replay"],
)
def test_plain_nodes_refuse_the_names_of_before(parameters, table):
    _, faults = check(parameters, dict.fromkeys(table, 1), table)
    assert faults == refused(table)


def test_the_tracker_refuses_the_names_of_before():
    given = dict.fromkeys([*replaced.TRACKER, *replaced.NODE], 1)
    expected = [*refused(replaced.TRACKER), *refused(replaced.NODE)]
    assert faults_of(tracker_node.resolve, given) == expected


def test_the_bridge_refuses_the_names_of_before():
    given = {"radars": ["a"], **dict.fromkeys(replaced.BRIDGE, 1)}
    assert faults_of(bridge.resolve, given) == refused(replaced.BRIDGE)
    given = {"radars": ["a"], **{f"a.{name}": 1 for name in replaced.BRIDGE_RADAR}}
    assert faults_of(bridge.resolve, given) == refused(replaced.BRIDGE_RADAR, "a.")


def test_the_hand_over_refuses_the_names_of_before():
    given = {**REGIONS, **dict.fromkeys(replaced.HAND_OVER, 1)}
    assert faults_of(hand_over.resolve, given) == refused(replaced.HAND_OVER)
    given = {**REGIONS, **{f"west.{name}": 1 for name in replaced.HAND_OVER_TRACKER}}
    assert faults_of(hand_over.resolve, given) == refused(replaced.HAND_OVER_TRACKER, "west.")


def test_changes_of_a_running_tracker_are_refused_alike():
    usual = tracker_node.resolve({})
    for change in (
        tracker_node.changed,
        lambda settings, c: tracker_node.edited(settings.values, c),
    ):
        with pytest.raises(ConfigError, match="publish_path: no longer a parameter, use outputs"):
            change(usual, {"publish_path": True})
