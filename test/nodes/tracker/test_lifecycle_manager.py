"""The tracker under a lifecycle manager that works as nav2's does.

The manager asks for a transition, and then for the state. After an activation it waits for a bond,
unless its `bond_timeout` is 0. The messages of bonds are not on PyPI: here the heartbeats are text,
see `helpers/live/bond_stand_in`, and their contents are not tested.
"""

from functools import partial
from pathlib import Path

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from live_radars import FAST
from std_msgs.msg import String

STAND_IN = Path(__file__).parents[2] / "helpers" / "live" / "bond_stand_in"
SITE = ("-r", "__ns:=/site")
MANAGED = ("--ros-args", *FAST, *SITE, "-p", "autostart:=false")
# Transitions that the manager requests, and the states that it expects then.
CONFIGURE = Transition.TRANSITION_CONFIGURE, State.PRIMARY_STATE_INACTIVE
ACTIVATE = Transition.TRANSITION_ACTIVATE, State.PRIMARY_STATE_ACTIVE
DEACTIVATE = Transition.TRANSITION_DEACTIVATE, State.PRIMARY_STATE_INACTIVE
CLEAN_UP = Transition.TRANSITION_CLEANUP, State.PRIMARY_STATE_UNCONFIGURED
SHUT_DOWN = Transition.TRANSITION_UNCONFIGURED_SHUTDOWN, State.PRIMARY_STATE_FINALIZED
STARTUP, PAUSE, RESUME = (CONFIGURE, ACTIVATE), (DEACTIVATE,), (ACTIVATE,)
RESET = (DEACTIVATE, CLEAN_UP)
SHUTDOWN = (*RESET, SHUT_DOWN)


def manage(peer, command):
    """Do what the manager does for a command; return whether each transition succeeded."""
    done = []
    for transition, expected in command:
        request = ChangeState.Request(transition=Transition(id=transition))
        changed = peer.call(ChangeState, "/site/tracker/change_state", request).success
        state = peer.call(GetState, "/site/tracker/get_state").current_state.id
        done.append(changed and state == expected)
    return done


def test_manager_takes_the_tracker_through_its_life_without_a_bond(processes, peer):
    tracker = processes.start("tracker", *MANAGED)
    for command in (STARTUP, PAUSE, RESUME, RESET, STARTUP, SHUTDOWN):
        assert all(manage(peer, command)), command
    assert not peer.node.count_publishers("/site/bond")
    # The log explains why the manager gives up and what to set.
    assert "nav2's manager needs bond_timeout: 0.0" in tracker.log.read_text()


@pytest.fixture
def bonds(processes, peer):
    """Return the received bonds of the namespace, and a publisher of them."""

    def start(*arguments):
        return processes.start("tracker", *arguments, PYTHONPATH=str(STAND_IN))

    heard = peer.collect(String, "/site/bond", 100)
    return start, heard, peer.publisher(String, "/site/bond")


def formed(manager, tracker, bonds):
    """Send a heartbeat of the manager; return whether the tracker has had that many bonds."""
    manager.publish(String(data="manager"))
    return tracker.log.read_text().count("manager formed") == bonds


def test_bond_lasts_while_the_tracker_is_active(bonds, peer):
    start, heard, manager = bonds
    tracker = start(*MANAGED)
    for command in (STARTUP, RESUME):
        heard.clear()
        assert all(manage(peer, command))
        assert peer.spin_until(lambda: len(heard) >= 3)
        assert {message.data for message in heard} == {"tracker alive"}
        assert peer.spin_until(lambda: manager.get_subscription_count() >= 2)
        assert peer.spin_until(partial(formed, manager, tracker, 1 + (command == RESUME)))
        assert all(manage(peer, PAUSE))
        assert peer.spin_until(lambda: heard[-1].data == "tracker dead")
        assert peer.spin_until(lambda: not peer.node.count_publishers("/site/bond") - 1)
    # A node that ends by intention is not reported as broken.
    assert "formed a bond" not in tracker.log.read_text()
    # It ends with the tracker too.
    assert all(manage(peer, RESUME))
    assert peer.spin_until(lambda: heard[-1].data == "tracker alive")
    tracker.terminate()
    assert peer.spin_until(lambda: heard[-1].data == "tracker dead")
    assert tracker.wait(20.0) == 0


def test_tracker_that_starts_by_itself_waits_for_no_manager(bonds, peer):
    start, heard, _ = bonds
    tracker = start("--ros-args", *FAST, *SITE)
    assert peer.spin_until(lambda: "tracking" in tracker.log.read_text())
    assert not peer.spin_until(lambda: heard, 1.0)
