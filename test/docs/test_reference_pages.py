import re
import shutil
from pathlib import Path

import pytest
import rclpy
from reference_pages import LISTS, PAGES, main, parameters, policies, topics
from reference_pages import declared as declared_in_all

from msg_adapters.encoding import names
from msg_adapters.outgoing import outputs
from phd_jdtc_ros.configuration.tables import GROUPS, TOP, parameters_of
from phd_jdtc_ros.nodes.asterix import AsterixBridge
from phd_jdtc_ros.nodes.evaluator import Evaluator
from phd_jdtc_ros.nodes.hand_over import HandOver
from phd_jdtc_ros.nodes.replay import SensorReplay
from phd_jdtc_ros.nodes.reports import ReportBridge
from phd_jdtc_ros.nodes.tracker import settings as tracker_node
from phd_jdtc_ros.nodes.tracker.node import Tracker
from phd_jdtc_ros.parameter_files import node_tables

ROOT = Path(__file__).parents[2]
BAG = str(ROOT / "bags" / "paper_scenario")
NAMED = ["-p", "radars:=[north]", "-p", "autostart:=false"]
JOINED = [
    *("-p", "trackers:=[west, east]"),
    *("-p", "west.region:=[-1.0, 0.0, 0.0, 1.0, 0.5]"),
    *("-p", "east.region:=[0.0, 0.0, 1.0, 1.0, 0.5]"),
]
NODES = {
    # Configured: before that every parameter may change.
    "tracker": (Tracker, []),
    "sensor_replay": (lambda: SensorReplay({"bag": BAG}), []),
    "evaluator": (Evaluator, []),
    "asterix_bridge": (AsterixBridge, NAMED),
    "report_bridge": (ReportBridge, ["-p", "autostart:=false"]),
    "hand_over": (HandOver, JOINED),
}
# Parameters whose values are not one type.
SEVERAL_WAYS = {
    name
    for prefixes, table in (
        ([""], (*TOP, *tracker_node.TABLE, *node_tables.REPLAY, *node_tables.EVALUATOR)),
        (["radar_1.", "radar_2."], parameters_of("radar")),
        ([f"start_{number}." for number in range(1, 5)], GROUPS["births"]),
    )
    for parameter in table
    if parameter.form is not None or (parameter.mutable and isinstance(parameter.default, list))
    for name in (f"{prefix}{parameter.name}" for prefix in prefixes)
}
# Parameters that every node of rclpy declares for itself.
OWN = ("use_sim_time", "start_type_description_service", "qos_overrides.")


@pytest.fixture
def declared(request):
    """Return what a node declares: by name, its descriptor and its value."""
    make, arguments = NODES[request.param]
    rclpy.init(args=["--ros-args", *arguments])
    node = make()
    names = [name for name in node.list_parameters([], 0).names if not name.startswith(OWN)]
    found = {
        descriptor.name: (descriptor, node.get_parameter(descriptor.name).value)
        for descriptor in node.describe_parameters(names)
    }
    node.destroy_node()
    rclpy.shutdown()
    return found


def rows(node, values):
    """Return a node's rows of the page: by full name, the mark and the meaning."""
    found = {}
    for section in parameters().split("\n## ")[1:]:
        title = section.splitlines()[0]
        if node not in re.split(", | and ", title):
            continue
        group = re.search(r"in `(\w+)`", title)
        prefixes = [f"{name}." for name in values[group[1]][1]] if group else [""]
        if group and group[1] == "sensors":
            prefixes = [p for p in prefixes if f"every {values[f'{p}kind'][1]} in" in title]
        for name, mark, text in re.findall(
            r"^\| `([\w.]+)`( \*)? \| `.*?` \| .*? \| (.*) \|$", section, re.MULTILINE
        ):
            found |= {f"{prefix}{name}": (bool(mark), text) for prefix in prefixes}
        # What each radar of the bridge may have too is listed once.
        for name in re.findall(r"`(\w+)`(?=[^|\n]* can be set for a radar too)", section):
            found |= {f"{prefix}{name}": found[name] for prefix in prefixes}
    return found


@pytest.fixture(scope="module")
def written_pages(tmp_path_factory):
    """Return where the current pages are written; lists in pages are rewritten."""
    docs = tmp_path_factory.mktemp("tree") / "docs"
    docs.mkdir()
    (docs.parent / "config").mkdir()
    for listed in LISTS:
        copy = docs / listed
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / "docs" / listed, copy)
    assert main([str(docs)]) == 0
    return docs


@pytest.mark.parametrize("name", [*PAGES, *LISTS, "../config/defaults.yaml"])
def test_reference_page_is_up_to_date(name, written_pages):
    written = (written_pages / name).read_text()
    assert (ROOT / "docs" / name).read_text() == written, "run make parameters"


def test_topics_and_policies_have_a_new_output(monkeypatch):
    usual = outputs.table

    def more(classes, engine=None):
        new = outputs.Output("~/new", names.CLOUD, "filtered", lambda *_: [], "new", usual=False)
        return (*usual(classes, engine), new)

    monkeypatch.setattr(outputs, "table", more)
    page = (ROOT / "docs" / "nodes" / "tracker.md").read_text()
    allowed = (ROOT / "config" / "sros2" / "policies.xml").read_text()
    row = (
        "| publishes, if enabled (`new`) | `~/new` | sensor_msgs/PointCloud2 | reliable, depth 10 |"
    )
    assert row in topics(page)
    # The tracker publishes it, the evaluator records it, the operator sees it.
    assert policies(allowed).count("<topic>/tracker/new</topic>") == 3


def test_no_more_parameters_are_declared_than_a_user_can_read():
    assert declared_in_all() <= 161


@pytest.mark.parametrize(("node", "declared"), [(n, n) for n in NODES], indirect=["declared"])
def test_page_lists_what_the_node_declares(node, declared):
    listed = rows(node, declared)

    # The given entries of a mapping are declared, and the mapping itself is not.
    assert {name for name in listed if not name.endswith((".fields", ".units"))} == {*declared}
    for name, (descriptor, _) in declared.items():
        mutable, text = listed[name]
        assert descriptor.description == text, name
        assert descriptor.additional_constraints.startswith("must be "), name
        # The tracker's structure.
        later = "while the node is not configured" in descriptor.additional_constraints
        assert descriptor.read_only != (mutable or later), name
        assert not (mutable and later), name


@pytest.mark.parametrize("declared", NODES, indirect=True)
def test_every_number_is_typed_and_ranged(declared):
    for name, (descriptor, value) in declared.items():
        # Empty lists have no type; others may be written in several ways.
        several = name in SEVERAL_WAYS
        free = value == [] or several
        assert descriptor.dynamic_typing == free, name
        if isinstance(value, bool) or several:
            continue
        ranges = [*descriptor.integer_range, *descriptor.floating_point_range]
        assert bool(ranges) == isinstance(value, (int, float)), name
