"""Warns if the tracker that a bag is played to has other radars, classes or birth places."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rclpy.node import Node

from msg_adapters.encoding import names
from phd_jdtc_ros.configuration import scene
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import bag_parameters

from ..common.tracker_parameters import TrackerParameters


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
