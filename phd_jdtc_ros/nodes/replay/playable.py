"""Selects which topics of a bag are played, and which of them make its scans."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.validate_full_topic_name import validate_full_topic_name

from msg_adapters.encoding import interfaces, names
from msg_adapters.incoming.readers import READERS
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration import scene
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import FILTERED
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import bag_parameters
from phd_jdtc_ros.quoting import short

from ..common.parameters import TrackerParameters

# Transient local topics, whose messages from before the selected part are published too.
LATCHED = (names.STATIC_FRAMES,)
# Topics that the replay itself, every node, or the nodes that the bag is played to publish.
LEFT_OUT = ("/clock", "/rosout", "/parameter_events", names.DIAGNOSTICS)
LEFT_OUT_UNDER = (f"{names.TRACKER}/", f"{names.OSPA.rpartition('/')[0]}/")

_TYPE_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")


@dataclass(frozen=True)
class Playable:
    """The part of a bag that is played."""

    classes: dict[str, Any]
    scan_topics: tuple[str, ...]  # Detections and truth, whose stamps define the scans
    detections: tuple[str, ...]  # The scan topics to which a tracker replies with an estimate
    truth: tuple[str, ...]  # The other scan topics
    skipped: tuple[str, ...]  # One line per topic that cannot be published


def select(bag: BagReader, wanted: list[str]) -> Playable:
    """Return the part of a bag that is played.

    If no topics are `wanted`, it has all but those that the tracker, the evaluator and every node
    publish. Raise `BagError` if a wanted topic is missing or cannot be published, if detections or
    the truth have a wrong type, or if there is nothing to play.
    """
    bag.require({topic: "a ROS 2 message" for topic in wanted if topic in bag.foreign})
    missing = [topic for topic in wanted if topic not in bag.types]
    if missing:
        raise BagError(
            f"{bag.path}: {', '.join(missing)} missing; it has {', '.join(sorted(bag.types))}"
        )
    left_out = LEFT_OUT_UNDER + _tracker_prefixes(bag.types)
    selected = wanted or [
        topic
        for topic in sorted(bag.types)
        if topic not in LEFT_OUT and not topic.startswith(left_out)
    ]
    detections = [topic for topic in selected if topic.endswith(names.DETECTIONS_SUFFIX)]
    truth = [topic for topic in selected if topic == names.TRUTH]
    readable = {reader.type_name for reader in READERS.values()}
    bag.require({t: names.CLOUD for t in [*detections, *truth] if bag.types[t] not in readable})
    if not detections:
        # A driver may publish its detections under another name.
        detections = [t for t in selected if bag.types[t] in readable]
        detections = [topic for topic in detections if topic not in truth]
    classes: dict[str, Any] = {}
    skipped = [] if wanted else [f"{t}: is {what}, not played" for t, what in bag.foreign.items()]
    for topic in selected:
        found = _message_class(bag.types[topic])
        if found is None:
            skipped.append(f"{topic}: type {bag.types[topic]} is not installed, not played")
        elif not _is_topic_name(topic):
            skipped.append(f"{topic}: is not a valid topic name, not played")
        else:
            classes[topic] = found
    if not classes or (wanted and skipped):
        reason = "; ".join(skipped) or f"it has {', '.join(sorted(bag.types)) or 'no topic'}"
        raise BagError(f"{bag.path}: has nothing to play: {reason}")
    detections = [topic for topic in detections if topic in classes]
    return Playable(
        classes, (*detections, *truth), tuple(detections), tuple(truth), tuple(map(short, skipped))
    )


def _tracker_prefixes(topics: Iterable[str]) -> tuple[str, ...]:
    """Return the topics' prefixes of all trackers, which are recognised by their estimates."""
    end = names.estimates(FILTERED, "")
    return tuple(topic.removesuffix(end) + "/" for topic in topics if topic.endswith(end))


def _is_topic_name(topic: str) -> bool:
    try:
        return bool(validate_full_topic_name(topic))
    except InvalidTopicNameException:
        return False


def _message_class(type_name: str) -> Any:
    """Return a message class, None without its package; a bag's name imports no other package."""
    match = _TYPE_NAME.fullmatch(type_name)
    if match is None:
        return None
    spec = importlib.util.find_spec(match[1])
    folders = (spec.submodule_search_locations if spec else None) or []
    if not any((Path(folder) / "msg" / "__init__.py").is_file() for folder in folders):
        return None
    try:
        found = interfaces.message_class(type_name)
    except (ImportError, AttributeError):
        return None
    return found if hasattr(found, "get_fields_and_field_types") else None


def begin(node: Node, bag: Path, estimates_topic: str) -> None:
    """Compare the parameters beside a bag, if any, with the tracker's, once it is there."""
    tracker, found, _ = estimates_topic.rpartition(names.estimates("filtered", ""))
    try:
        recorded = bag_parameters.read(bag)
        if recorded is None or not found:
            return
        expected = resolve(recorded, SystemPlane).values
    except ConfigError as error:
        # The bag can be played all the same.
        node.get_logger().warning(f"the parameters beside the bag are not compared: {error}")
        return

    def compare(given: dict[str, Any]) -> None:
        wrong = scene.differences(expected, given)
        if wrong:
            node.get_logger().warning(
                f"the bag was recorded with other parameters than {tracker} has: "
                f"{'; '.join(wrong)}; those of the bag are in {bag_parameters.path_of(bag)}"
            )

    TrackerParameters(node, tracker, compare)
