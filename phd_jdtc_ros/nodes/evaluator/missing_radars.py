"""Warns if a recording lacks a radar, or its poses, that the tracker subscribes to."""

from __future__ import annotations

from collections.abc import Collection

from rclpy._rclpy_pybind11 import NodeNameNonExistentError
from rclpy.node import Node

from msg_adapters import platform_poses
from msg_adapters.readers import READERS

from ..common.callbacks import steady_timer

PERIOD_S = 0.5
# Types of the tracker's inputs, and what the tracker has of them.
KINDS = {
    **{reader.type_name: "a radar's detections" for reader in READERS.values()},
    **dict.fromkeys(platform_poses.TYPES.values(), "the poses of a radar that moves"),
}


class MissingRadars:
    """Warns of the tracker's topics of detections or poses that are not recorded.

    They are looked up in the graph and not in the parameters, because topics can be remapped.
    `recorded` are the full names of the recorded topics.
    """

    def __init__(self, node: Node, tracker: str, recorded: Collection[str]) -> None:
        self._node = node
        self._tracker = tracker
        self._known = set(recorded)
        steady_timer(node, PERIOD_S, self._check)

    def _check(self) -> None:
        namespace, _, name = self._tracker.rpartition("/")
        try:
            inputs = self._node.get_subscriber_names_and_types_by_node(name, namespace or "/")
        except NodeNameNonExistentError:  # it has not started, or has ended
            return
        for topic, types in inputs:
            kinds = [KINDS[kind] for kind in types if kind in KINDS]
            if kinds and topic not in self._known:
                self._known.add(topic)
                self._node.get_logger().warning(
                    f"{topic}, of which {self._tracker} has {kinds[0]}, is not among record_topics "
                    "and is not recorded"
                )
