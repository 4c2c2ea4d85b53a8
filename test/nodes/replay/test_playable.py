import sys

import pytest
from mcap_files import write

from msg_adapters.encoding import names
from msg_adapters.outgoing import outputs
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.nodes import playback

RADAR = names.detections("radar_1")


def choose(tmp_path, types, wanted=()):
    bag = write(tmp_path / "bag.mcap", types, [(topic, 0, b"") for topic in types])
    return playback.select(BagReader(bag), list(wanted))


def test_choose_takes_foreign_topics_and_any_cloud_for_detections(tmp_path):
    found = choose(tmp_path, {RADAR: names.CLOUD, "/note": "std_msgs/msg/String"})
    assert set(found.classes) == {RADAR, "/note"}
    assert found.scan_topics == found.detections == (RADAR,)
    assert found.skipped == ()
    types = {"/smart_radar/port_targets_0": names.CLOUD, names.TRUTH: names.CLOUD}
    found = choose(tmp_path, types)
    assert found.detections == ("/smart_radar/port_targets_0",)
    assert found.scan_topics == ("/smart_radar/port_targets_0", names.TRUTH)


@pytest.mark.parametrize(
    "topic", ["/clock", "/rosout", "/diagnostics", "/tracker/filtered/estimates", "/evaluator/ospa"]
)
def test_choose_leaves_out_what_live_nodes_publish_unless_it_is_wanted(tmp_path, topic):
    types = {RADAR: names.CLOUD, topic: "std_msgs/msg/String"}
    assert set(choose(tmp_path, types).classes) == {RADAR}
    assert set(choose(tmp_path, types, [topic]).classes) == {topic}


def test_choose_leaves_out_other_trackers_and_names_that_are_no_topics(tmp_path):
    recorded = [*outputs.default_topics(2, "/site/t2"), RADAR]
    found = choose(tmp_path, dict.fromkeys(recorded, names.CLOUD))
    assert (set(found.classes), found.detections) == ({RADAR}, (RADAR,))
    found = choose(tmp_path, {RADAR: names.CLOUD, "no topic": "std_msgs/msg/String"})
    assert found.skipped == ("no topic: is not a valid topic name, not played",)


@pytest.mark.parametrize(
    "type_name",
    [
        "nobody_has_this/msg/Thing",
        "std_msgs/msg/NoSuchMessage",
        "std_msgs/String",
        "../evil/msg/Thing",
    ],
)
def test_choose_skips_a_type_that_is_not_installed_with_one_line(tmp_path, type_name):
    found = choose(tmp_path, {RADAR: names.CLOUD, "/thing": type_name})
    assert set(found.classes) == {RADAR}
    assert found.skipped == (f"/thing: type {type_name} is not installed, not played",)


def test_choose_cuts_what_it_quotes_of_a_bag(tmp_path):
    types = {RADAR: names.CLOUD, "/thing": "x" * 10**6}
    (line,) = choose(tmp_path, types).skipped
    with pytest.raises(BagError) as caught:
        choose(tmp_path, types, ["/thing"])
    assert max(len(line), len(str(caught.value))) < 5000
    assert line.startswith("/thing: type xxx")


def test_choose_imports_nothing_that_is_no_message_package(tmp_path, monkeypatch):
    package = tmp_path / "trap"
    package.mkdir()
    (package / "__init__.py").write_text("raise SystemExit('imported')")
    (package / "msg.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    found = choose(tmp_path, {RADAR: names.CLOUD, "/thing": "trap/msg/Thing"})
    assert len(found.skipped) == 1
    assert "trap" not in sys.modules


@pytest.mark.parametrize(
    ("wanted", "text"),
    [
        (["/gone"], "/gone missing; it has /note, /thing"),
        (["/thing"], "/thing: type other/msg/Thing is not installed"),
        ([], "/note: type other/msg/Note is not installed"),
    ],
)
def test_choose_refuses_what_cannot_be_played(tmp_path, wanted, text):
    types = {"/note": "other/msg/Note", "/thing": "other/msg/Thing"}
    with pytest.raises(BagError, match=text):
        choose(tmp_path, types, wanted)
