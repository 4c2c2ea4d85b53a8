"""A live tracker's parameters: their descriptions, and their changes."""

import pytest
from live_radars import change, connected, start_tracker, state_of
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter

LOCKED = "lag: cannot change while the tracker is configured, clean it up before"


def set_one_by_one(peer, values):
    """Set parameters by the service that checks each by itself; return the results."""
    messages = [Parameter(n, value=v).to_parameter_msg() for n, v in values.items()]
    request = SetParameters.Request(parameters=messages)
    return peer.call(SetParameters, "/tracker/set_parameters", request).results


@pytest.fixture(scope="module")
def peer(lasting):
    return lasting[1]


@pytest.fixture(scope="module")
def tracker(lasting, peer):
    """Return the process of an active tracker, whose parameters the tests change in their order."""
    process = start_tracker(lasting[0])
    assert peer.spin_until(lambda: state_of(peer) == "active")
    return process


def test_parameters_have_descriptions_ranges_and_whether_they_may_change(tracker, peer):
    asked = ["equipped_probability", "lag", "checkpoint.every"]
    request = DescribeParameters.Request(names=asked)
    reply = peer.call(DescribeParameters, "/tracker/describe_parameters", request)
    threshold, lag, every = reply.descriptors
    assert not any(d.read_only for d in reply.descriptors)
    when = "; changes while the node is not configured"
    told = [d.additional_constraints.endswith(when) for d in reply.descriptors]
    assert told == [False, True, True]
    assert (threshold.floating_point_range[0].to_value, lag.integer_range[0].to_value) == (
        0.999,
        100,
    )
    assert (
        every.description
        == "Number of scans between checkpoints; 0 for checkpoints on request only."
    )
    assert every.integer_range[0].to_value == 10**6


def test_own_parameters_given_again_are_no_change(tracker, peer):
    """As by ``ros2 param load`` of what ``ros2 param dump`` has written."""
    names = peer.call(ListParameters, "/tracker/list_parameters").result.names
    request = GetParameters.Request(names=names)
    values = peer.call(GetParameters, "/tracker/get_parameters", request).values
    own = [ParameterMessage(name=n, value=v) for n, v in zip(names, values, strict=True)]
    threshold = next(p for p in own if p.name == "equipped_probability")
    threshold.value.double_value = 0.875
    request = SetParameters.Request(parameters=own)
    results = peer.call(SetParameters, "/tracker/set_parameters", request).results
    refused = [p.name for p, result in zip(own, results, strict=True) if not result.successful]
    # The parameters that rclpy declares for itself are read-only.
    assert all(name.startswith(("qos_overrides.", "start_type")) for name in refused), refused
    assert len(own) > 50
    log = peer.said(tracker, "changed: ")
    (line,) = [row for row in log.splitlines() if "changed: " in row]
    assert line.endswith("changed: equipped_probability 0.875")


def test_single_parameters_are_set_and_refused_one_by_one(tracker, peer):
    wanted = {"radar_1.clutter_rate": 30, "lag": 4, "use_sim_time": True, "survival": 1.0}
    assert [(r.successful, r.reason) for r in set_one_by_one(peer, wanted)] == [
        (True, ""),
        (False, LOCKED),
        (True, ""),
        (False, "survival: unknown parameter"),
    ]


def test_every_parameter_may_change_after_a_cleanup(tracker, peer):
    connected(peer).track(0)
    assert change(peer, "DEACTIVATE")
    (refused,) = set_one_by_one(peer, {"lag": 3})
    assert not refused.successful
    assert change(peer, "CLEANUP")

    # One by one they do not fit together for a while, in whatever order they come.
    results = set_one_by_one(
        peer,
        {
            "lag": 3,
            "sensors": ["radar_1", "north"],
            "north.topic": "/north/plots",
            "detection_births.rates": [0.1, 0.1, 0.1],
            "births": [],
            "outputs": ["paths"],
        },
    )
    assert [result.successful for result in results] == [True] * 6
    assert "detection_births.rates" in results[3].reason
    (wrong,) = set_one_by_one(peer, {"radar_2.topic": "/gone"})
    assert (wrong.successful, wrong.reason) == (
        False,
        "radar_2.topic: unknown parameter, radar_2 is not in sensors (radar_1, north)",
    )
    assert not change(peer, "CONFIGURE")
    assert state_of(peer) == "unconfigured"

    (right,) = set_one_by_one(peer, {"detection_births.rates": []})
    assert right.successful
    assert change(peer, "CONFIGURE", "ACTIVATE")
    assert peer.spin_until(lambda: peer.node.count_subscribers("/north/plots"))
    assert not peer.node.count_subscribers("/radar_2/detections")
    assert peer.spin_until(lambda: peer.node.count_publishers("/tracker/tracks/path"))
    (locked,) = set_one_by_one(peer, {"lag": 4})
    assert locked.reason == LOCKED
