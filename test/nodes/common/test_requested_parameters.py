"""Requests of a tracker's parameters whose reply is lost or empty."""

import pytest
import rclpy
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from phd_jdtc_ros.nodes.common.parameters import TrackerParameters


class Tracker:
    """A node with parameters that replies only while it is served."""

    def __init__(self, peer):
        self.node = rclpy.create_node("tracker", context=peer.node.context)
        self._peer = peer
        self._executor = SingleThreadedExecutor(context=peer.node.context)
        self._executor.add_node(self.node)

    def serve_until(self, condition, timeout=20.0):
        def served():
            self._executor.spin_once(timeout_sec=0.0)
            return condition()

        return self._peer.spin_until(served, timeout)

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()


@pytest.fixture
def received(peer):
    """Return the parameters that the test's node receives."""
    found = []
    TrackerParameters(peer.node, "/tracker", found.append)
    return found


@pytest.fixture
def tracker(peer):
    node = Tracker(peer)
    yield node
    node.close()


def test_lost_reply_is_requested_again_of_the_successor(peer, received):
    killed = rclpy.create_node("tracker", context=peer.node.context, start_parameter_services=False)
    lists = killed.create_service(ListParameters, "~/list_parameters", None)
    killed.create_service(GetParameters, "~/get_parameters", None)
    # It takes the request, and ends before it replies.
    taken = lists.handle.service_take_request
    assert peer.spin_until(lambda: taken(ListParameters.Request)[0] is not None)
    killed.destroy_node()
    successor = Tracker(peer)
    successor.node.declare_parameter("lag", "5")
    try:
        assert successor.serve_until(lambda: received)
    finally:
        successor.close()
    assert received[0]["lag"] == "5"


def test_empty_reply_is_repeated(peer, received, tracker):
    """A listed parameter without a value makes the whole reply empty."""
    tracker.node.declare_parameter("lag", Parameter.Type.STRING)
    assert not tracker.serve_until(lambda: received, 1.0)
    tracker.node.set_parameters([Parameter("lag", value="5")])
    assert tracker.serve_until(lambda: received)
    assert received[0]["lag"] == "5"


def test_parameters_are_received_once(peer, received, tracker):
    assert tracker.serve_until(lambda: received)
    assert not tracker.serve_until(lambda: len(received) > 1, 3.0)
