"""The shipped DDS profile keeps a rogue out and lets local traffic through."""

from xml.etree import ElementTree

import pytest

from phd_jdtc_ros.resources import PROFILE_VARIABLES, isolation
from robustness.harness.isolation import ISOLATED, PROFILE
from robustness.operation import network

SPACE = "{http://www.eprosima.com}"


def test_profile_names_the_loopback_interface_alone():
    document = ElementTree.parse(PROFILE)
    listed = [a.text for a in document.iter(f"{SPACE}interfaceWhiteList") for a in a]
    assert listed == ["127.0.0.1"]
    assert [e.text for e in document.iter(f"{SPACE}useBuiltinTransports")] == ["false"]
    (participant,) = document.iter(f"{SPACE}participant")
    assert participant.get("is_default_profile") == "true"


def test_demo_uses_the_profile(monkeypatch):
    for name in PROFILE_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    assert isolation() == ISOLATED


def test_demo_leaves_a_profile_of_the_user_in_force(monkeypatch):
    monkeypatch.setenv(PROFILE_VARIABLES[0], "mine.xml")
    assert isolation() == {}


@pytest.mark.live
def test_rogue_gets_in_without_the_profile_and_not_with_it():
    # A participant that misses the first announcements gets the next, 3 s later.
    figure = network.measure(("the demo's", network.WITHOUT), seconds=7.0)
    if figure.measured is None:
        pytest.skip(figure.reason)
    assert figure.reached, figure.measured
