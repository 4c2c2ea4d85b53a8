"""Says so if a recording leaves out a radar, or its poses, that the tracker subscribes to."""

from __future__ import annotations

from collections.abc import Collection

from rclpy._rclpy_pybind11 import NodeNameNonExistentError
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from msg_adapters import platform_poses
from msg_adapters.readers import READERS

PERIOD_S = 0.5


class MissingRadars:
    """Warns of every topic of detections or poses that the tracker has and a recording has not.

    They are those of the graph and not of the parameters, because topics can be remapped.

    Parameters
    ----------
    tracker : str
        The tracker's full name.
    recorded : collection of str
        Full names of the recorded topics.
    """

    def __init__(self, node: Node, tracker: str, recorded: Collection[str]) -> None:
        self._node = node
        self._tracker = tracker
        self._known = set(recorded)
        self._kinds = {reader.type_name for reader in READERS.values()}
        self._poses = frozenset(platform_poses.TYPES.values())
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(PERIOD_S, self._look, clock=steady)

    def _look(self) -> None:
        namespace, _, name = self._tracker.rpartition("/")
        try:
            inputs = self._node.get_subscriber_names_and_types_by_node(name, namespace or "/")
        except NodeNameNonExistentError:  # it has not started, or has ended
            return
        for topic, types in inputs:
            if topic not in self._known and self._kinds.intersection(types):
                self._known.add(topic)
                self._node.get_logger().warning(
                    f"{topic}, of which {self._tracker} has a radar's detections, is not among "
                    "record_topics and is not recorded"
                )
            elif topic not in self._known and self._poses.intersection(types):
                self._known.add(topic)
                self._node.get_logger().warning(
                    f"{topic}, of which {self._tracker} has the poses of a radar that moves, is "
                    "not among record_topics and is not recorded"
                )
