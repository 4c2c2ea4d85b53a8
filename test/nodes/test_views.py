"""The shipped RViz configuration and Foxglove layout against what the running nodes publish."""

import json
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from live_radars import options, start_tracker
from message_paths import values
from rclpy.qos import (
    DurabilityPolicy,
    LivelinessPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics, outputs
from msg_adapters.targets.markers import COLOURS

ROOT = Path(__file__).parents[2]
BAG = ROOT / "bags" / "paper_scenario"
RVIZ = yaml.safe_load((ROOT / "rviz" / "demo.rviz").read_text())
LAYOUT = json.loads((ROOT / "foxglove" / "layout.json").read_text())

MAP = LAYOUT["configById"]["3D!map"]
PANELS = LAYOUT["configById"]
SERIES = {
    path["value"]: (name, path)
    for name, panel in PANELS.items()
    if name.startswith("Plot!")
    for path in panel["paths"]
}
DETECTIONS = names.detections_in_map()
# The least contrast of graphics to their background, by the accessibility guidelines WCAG 2.
VISIBLE = 3.0
NUMBERS = [topic for topic, kind in outputs.default_topics(2).items() if kind == names.NUMBER]
SHOWN = {
    DETECTIONS,
    names.TRUTH,
    names.estimates("filtered"),
    names.estimates("smoothed"),
    f"{names.TRACKER}/markers",
    names.clutter_map(),
}


def contrast(*colours):
    """Return the contrast of two colours, red, green and blue from 0 to 255, after WCAG 2."""

    def luminance(colour):
        parts = [part / 255.0 for part in colour]
        linear = [p / 12.92 if p <= 0.03928 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    low, high = sorted(map(luminance, colours))
    return (high + 0.05) / (low + 0.05)


def rviz_displays():
    """Return the displays of the configuration that listen to a topic, by it."""
    displays = RVIZ["Visualization Manager"]["Displays"]
    return {d["Topic"]["Value"]: d for d in displays if "Topic" in d}


def rviz_qos(display):
    """Return the QoS that a display asks for."""
    topic = display["Topic"]
    return QoSProfile(
        depth=topic["Depth"],
        reliability={
            "Reliable": ReliabilityPolicy.RELIABLE,
            "Best Effort": ReliabilityPolicy.BEST_EFFORT,
        }[topic["Reliability Policy"]],
        durability={
            "Volatile": DurabilityPolicy.VOLATILE,
            "Transient Local": DurabilityPolicy.TRANSIENT_LOCAL,
        }[topic["Durability Policy"]],
        liveliness=LivelinessPolicy.AUTOMATIC,
    )


class Live:
    """The tracker, the evaluator and the replay, and their messages."""

    def __init__(self, peer):
        self.peer = peer
        topics = (names.OSPA, names.cardinality(), names.DIAGNOSTICS)
        self.heard = {topic: peer.collect(DiagnosticArray, topic) for topic in topics}
        # Their width is the number of targets.
        clouds = {path.partition(".")[0] for path in SERIES} - self.heard.keys()
        self.heard |= {topic: peer.collect(PointCloud2, topic) for topic in clouds}
        self.numbers = {topic: peer.collect(Float64, topic) for topic in NUMBERS}

    def publishers(self, topic):
        return self.peer.node.get_publishers_info_by_topic(topic)


@pytest.fixture(scope="module")
def live(lasting):
    processes, peer = lasting
    heard = Live(peer)
    processes.start("evaluator")
    start_tracker(processes, *options(**{"radar_1.clutter_map": "true"}))
    assert peer.spin_until(lambda: peer.node.count_publishers(names.OSPA))
    assert peer.spin_until(lambda: peer.node.count_publishers(names.cardinality()))
    processes.start("sensor_replay", BAG, "--rate", "20", "--loop")
    assert peer.spin_until(lambda: all(heard.heard.values()), 30.0)
    assert peer.spin_until(lambda: all(map(peer.node.count_publishers, SHOWN)))
    # One score a source and stamp.
    assert peer.spin_until(
        lambda: len({m.status[0].name.split("/")[0] for m in heard.heard[names.OSPA]}) == 2
    )
    return heard


def test_views_fit_the_running_nodes(live):
    for topic, display in rviz_displays().items():
        offered = live.publishers(topic)
        assert offered, f"nobody publishes {topic}"
        for info in offered:
            kind = {"PointCloud2": names.CLOUD, "MarkerArray": names.MARKERS, "Map": names.GRID}
            assert info.topic_type == kind[display["Class"].split("/")[1]], topic
            fits, reason = qos_check_compatible(info.qos_profile, rviz_qos(display))
            assert fits == QoSCompatibility.OK, f"{topic}: {reason}"
            # A late RViz gets the last markers only if it asks for them.
            assert rviz_qos(display).durability == info.qos_profile.durability, topic
    for topic in MAP["topics"]:
        assert live.publishers(topic), f"nobody publishes {topic}"
    for path in SERIES:
        topic, _, rest = path.partition(".")
        found = [v for message in live.heard[topic] for v in values(message, f".{rest}")]
        assert found, f"{path} leads to nothing"
        assert all(isinstance(float(value), float) for value in found)


def test_every_number_for_plots_is_published_and_is_that_of_the_diagnostics(live):
    assert live.peer.spin_until(lambda: all(live.numbers.values()))
    scored, stepped = [], []
    for message in live.heard[names.OSPA]:
        for status in message.status:
            scored += [(status.name, k, v) for k, v in diagnostics.values_of(status).items()]
    for message in live.heard[names.cardinality()]:
        stepped += diagnostics.values_of(message.status[0]).items()
    for topic, heard in live.numbers.items():
        node, _, quantity = topic.partition("/plot/")
        where, _, name = quantity.rpartition("/")
        if node == names.EVALUATOR:
            said = {float(value) for s, key, value in scored if (s, key) == (where, name)}
        else:
            said = {float(value) for key, value in stepped if key == name}
        assert heard[0].data in said, topic


def test_rviz_and_foxglove_show_every_topic():
    options = RVIZ["Visualization Manager"]["Global Options"]
    assert set(rviz_displays()) == SHOWN
    assert options["Fixed Frame"] == "map"
    assert all(display["Enabled"] for display in rviz_displays().values())
    assert set(MAP["topics"]) == SHOWN
    assert MAP["followTf"] == "map"


def test_colours_are_those_of_the_report():
    def rgb(hexadecimal):
        return "; ".join(str(int(hexadecimal[k : k + 2], 16)) for k in (1, 3, 5))

    for topic in (names.TRUTH, names.estimates("filtered"), names.estimates("smoothed")):
        display, setting = rviz_displays()[topic], MAP["topics"][topic]
        assert (display["Channel Name"], setting["colorField"]) == ("class_id", "class_id")
        assert [display["Min Color"], display["Max Color"]] == [rgb(c) for c in COLOURS[:2]]
        assert [colour[:7] for colour in setting["gradient"]] == list(COLOURS[:2])
        assert (display["Min Intensity"], display["Max Intensity"]) == (0, 1)
        assert (setting["minValue"], setting["maxValue"]) == (0, 1)


def test_detections_of_every_driver_are_coloured_by_amplitude():
    display, setting = rviz_displays()[DETECTIONS], MAP["topics"][DETECTIONS]
    assert (display["Channel Name"], display["Color Transformer"]) == ("amplitude", "Intensity")
    assert setting["colorField"] == "amplitude"
    assert not any(name.endswith("/detections") for name in SHOWN - {DETECTIONS})


@pytest.mark.parametrize("end", ["Min Color", "Max Color"])
def test_detections_stand_out_from_the_background_in_rviz(end):
    options = RVIZ["Visualization Manager"]["Global Options"]
    colours = (rviz_displays()[DETECTIONS][end], options["Background Color"])
    assert contrast(*([int(part) for part in colour.split(";")] for colour in colours)) >= VISIBLE


@pytest.mark.parametrize("end", [0, 1])
def test_detections_stand_out_from_the_background_in_foxglove(end):
    colours = (MAP["topics"][DETECTIONS]["gradient"][end], MAP["scene"]["backgroundColor"])
    assert contrast(*([*bytes.fromhex(colour[1:])] for colour in colours)) >= VISIBLE
