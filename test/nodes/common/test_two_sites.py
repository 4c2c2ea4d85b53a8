"""Diagnostics of two sites, and the shipped analyzers of diagnostic_aggregator for them.

The aggregator itself is in C++ and not on PyPI. What its GenericAnalyzer takes, and how it names
that, is written here after its documentation.
"""

import re
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from live_radars import FAST

ROOT = Path(__file__).parents[3]
ANALYZERS = ROOT / "config" / "diagnostics"
SITES = ("/site_a", "/site_b")
LINES = ("summary", "radar_1", "radar_2", "step time", "outputs")


class Aggregator:
    """What the aggregator makes of a file of analyzers."""

    def __init__(self, path):
        (document,) = [yaml.safe_load(path.read_text())]
        # The node's name, and so the only section that it reads, is a fixed one.
        ((name, section),) = document.items()
        assert name == "analyzers"
        parameters = section["ros__parameters"]
        self.root = parameters.pop("path")
        self.analyzers = parameters

    def places(self, name):
        """Return where a status appears in the tree: in each analyzer that takes it."""
        for analyzer in self.analyzers.values():
            assert analyzer["type"] == "diagnostic_aggregator/GenericAnalyzer"
            removed = analyzer.get("find_and_remove_prefix", [])
            taken = any(name.startswith(prefix) for prefix in removed) or any(
                re.fullmatch(expression, name) for expression in analyzer.get("regex", [])
            )
            if taken:
                shown = name.replace("/", " ")
                for prefix in removed:
                    shown = shown.removeprefix(prefix.replace("/", " "))
                yield f"/{self.root}/{analyzer['path']}/{shown.strip()}"


@pytest.fixture(scope="module")
def statuses(lasting):
    """Return the statuses of one tracker in each of two namespaces, by name."""
    processes, peer = lasting
    heard = peer.collect(DiagnosticArray, "/diagnostics", 50)
    for site in SITES:
        processes.start("tracker", "--ros-args", *FAST, "-r", f"__ns:={site}")

    def found():
        return {status.name: status for message in heard for status in message.status}

    assert peer.spin_until(lambda: len(found()) >= len(SITES) * len(LINES))
    return found()


def test_diagnostics_of_two_sites_have_different_names(statuses):
    assert set(statuses) == {f"{site}/tracker: {line}" for site in SITES for line in LINES}
    for site in SITES:
        ids = {line: statuses[f"{site}/tracker: {line}"].hardware_id for line in LINES}
        assert ids == {
            "radar_1": f"{site}/tracker/radar_1",
            "radar_2": f"{site}/tracker/radar_2",
            "step time": f"{site}/tracker",
            "outputs": f"{site}/tracker",
            "summary": f"{site}/tracker",
        }


def test_shipped_analyzers_take_every_status_of_two_sites_once(statuses):
    trackers = Aggregator(ANALYZERS / "trackers.yaml")
    places = {name: list(trackers.places(name)) for name in statuses}
    assert {name: len(found) for name, found in places.items()} == dict.fromkeys(statuses, 1)
    assert places["/site_b/tracker: radar_1"] == ["/Tracking/Radars/site_b tracker: radar_1"]
    assert places["/site_a/tracker: step time"] == ["/Tracking/Step time/site_a tracker: step time"]
    sites = Aggregator(ANALYZERS / "sites.yaml")
    assert {name: list(sites.places(name)) for name in statuses} == {
        f"/site_{site}/tracker: {line}": [f"/Tracking/Site {site.upper()}/{line}"]
        for site in "ab"
        for line in LINES
    }


@pytest.mark.parametrize("name", ["camera: focus", "/site_a/tracker_2: radar_1", "trackers: load"])
def test_shipped_analyzers_take_nothing_of_other_nodes(name):
    for path in ANALYZERS.glob("*.yaml"):
        assert list(Aggregator(path).places(name)) == []
