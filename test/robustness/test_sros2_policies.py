"""The shipped policies give each node what it uses on the live graph, and nothing else."""

import re
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest
import rclpy
import stand_ins

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics
from msg_adapters.outgoing.outputs import STREAMS
from phd_jdtc_ros.nodes.tracker import settings
from robustness.harness.rig import Rig
from robustness.harness.scans import BAG

ROOT = Path(__file__).parents[2]
POLICIES = ROOT / "config" / "sros2" / "policies.xml"
QUERIES = {
    ("topics", "publish"): "get_publisher_names_and_types_by_node",
    ("topics", "subscribe"): "get_subscriber_names_and_types_by_node",
    ("services", "reply"): "get_service_names_and_types_by_node",
    ("services", "request"): "get_client_names_and_types_by_node",
}
# Every option that takes a topic or a service is on.
SIMULATED = ("-p", "use_sim_time:=true")
# Streams to other programs are no topics.
OUTPUTS = ",".join({*settings.OUTPUTS} - {row.switch for row in STREAMS})
ARGUMENTS = {
    "tracker": (
        *("--ros-args", "-p", "radar_1.clutter_map:=true", "-p", "world_origin:=[52.0, 4.0, 0.0]"),
        *("-p", f"outputs:=[{OUTPUTS}]", "-p", "conflicts.distance:=[500.0]"),
    ),
    "asterix_bridge": (
        *("--ros-args", "-p", "radars:=[radar_1, radar_2]", "-p", "radar_2.source:=[0, 1]"),
        *("-p", "inputs:=[]", "-p", "output:='127.0.0.1:9'"),
    ),
    "report_bridge": ("--ros-args", "-p", "inputs:=[]"),
    "hand_over": (
        *("--ros-args", "-p", "trackers:=[west, east]"),
        *("-p", "west.region:=[-1.0, 0.0, 0.0, 1.0, 0.5]"),
        *("-p", "east.region:=[0.0, 0.0, 1.0, 1.0, 0.5]"),
    ),
    "evaluator": ("--ros-args", "-p", "record:={directory}/bag"),
    "sensor_replay": (
        *(BAG, "--rate", "0", "--ros-args", "-p", "start_paused:=true"),
        *("-p", "flush_service:=/tracker/flush"),
    ),
    "picture": ("--port", "0", "--ros-args"),
}
# A tracker has the figures of its engine; another engine has others.
FIGURES = {names.curve(name) for figures in diagnostics.FIGURES.values() for name in figures}
PAGE = (ROOT / "docs" / "nodes" / "tracker.md").read_text()


def allowed():
    """Return the rights by node and by kind."""
    found = {}
    for profile in ElementTree.parse(POLICIES).iter("profile"):
        rights = {key: set() for key in QUERIES}
        for group in profile:
            for verb in ("publish", "subscribe", "reply", "request"):
                if group.get(verb) == "ALLOW":
                    rights[group.tag, verb] |= {entry.text for entry in group}
        found[profile.get("node")] = rights
    return found


@pytest.fixture(scope="module")
def used():
    """Return what each node has on the live graph, by kind."""
    with Rig() as rig:
        # Some switches need message packages that the wheels do not bring.
        packages = stand_ins.write(rig.directory / "packages")
        for name, arguments in ARGUMENTS.items():
            words = [str(word).format(directory=rig.directory) for word in arguments]
            rig.start(name, *words, *SIMULATED, **packages)
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=rig.domain)
        watcher = rclpy.create_node("watcher", context=context)

        def graph():
            there = set(watcher.get_node_names())
            return {
                name: {
                    key: {
                        *(entry for entry, _ in getattr(watcher, query)(name, "/")),
                        *(FIGURES if (name, key) == ("tracker", ("topics", "publish")) else ()),
                    }
                    for key, query in QUERIES.items()
                }
                for name in ARGUMENTS
                if name in there
            }

        def as_allowed(found):
            return all(
                found.get(name, {}).get(key, set()) == allowed()[name][key]
                for name in ARGUMENTS
                for key in QUERIES
            )

        # Nodes that still start have less. Until it is what is allowed and has been so for a while.
        found, since, end = {}, time.monotonic(), time.monotonic() + 60.0
        while time.monotonic() < end:
            try:
                now = graph()
            except rclpy._rclpy_pybind11.NodeNameNonExistentError:
                now = {}
            if now != found:
                found, since = now, time.monotonic()
            if as_allowed(found) and time.monotonic() - since > 2.0:
                break
            time.sleep(0.1)
        watcher.destroy_node()
        rclpy.shutdown(context=context)
        return found


@pytest.mark.live
@pytest.mark.parametrize("name", ARGUMENTS)
@pytest.mark.parametrize("key", QUERIES, ids=["publish", "subscribe", "reply", "request"])
def test_policies_allow_what_a_node_uses_and_nothing_else(used, name, key):
    assert allowed()[name][key] == used[name][key]


def documented(kind):
    """Return the names in the rows of that kind in the tracker's page, of two classes."""
    rows = re.findall(rf"^\| {kind}[^|]*\|([^|]*)\|", PAGE, re.MULTILINE)
    found = {name for row in rows for name in re.findall(r"`([^`]+)`", row)}
    return {
        name.replace("~", "/tracker").replace("{filtered,smoothed}", source).replace("K", number)
        for name in found
        for source in ("filtered", "smoothed")
        for number in "01"
    }


# Topics and services that every node, or every managed node, has besides.
OF_EVERY_NODE = re.compile(
    r"/(rosout|parameter_events|clock)|.*(parameter|type_desc|state|transition).*"
)


@pytest.mark.live
@pytest.mark.parametrize(
    ("kind", "key"),
    [("publishes", ("topics", "publish")), ("service", ("services", "reply"))],
    ids=lambda entry: entry if isinstance(entry, str) else "",
)
def test_page_of_the_tracker_lists_every_topic_and_service(used, kind, key):
    own = {name for name in used["tracker"][key] if not OF_EVERY_NODE.fullmatch(name)}
    assert documented(kind) == own


def test_operator_sees_every_topic_of_the_nodes():
    rights = allowed()
    topics = {topic for name in ARGUMENTS for topic in rights[name]["topics", "publish"]}
    assert (
        topics - {"/parameter_events", "/tracker/_instance"}
        <= (rights["operator"]["topics", "subscribe"])
    )


@pytest.mark.parametrize("name", [p.name for p in settings.TABLE])
def test_page_of_the_tracker_lists_every_parameter_of_the_node(name):
    assert f"`{name}`" in PAGE.partition("## Parameters")[2]


def test_policies_have_enclaves_and_let_no_node_write_parameters():
    for name, rights in allowed().items():
        if name != "operator":
            assert not {
                entry for entry in rights["services", "request"] if "set_parameters" in entry
            }
    document = ElementTree.parse(POLICIES)
    paths = {enclave.get("path") for enclave in document.iter("enclave")}
    assert document.getroot().get("version") == "0.2.0"
    assert paths == {f"/phd_jdtc_ros/{name}" for name in (*ARGUMENTS, "operator")}
