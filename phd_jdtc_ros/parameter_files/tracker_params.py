"""Reads a live tracker's parameters for launch files and offline tools."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phd_jdtc_ros.configuration import tracker_node
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import sections

# Parameters that rclpy gives every node.
_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")


def config(given: Mapping[str, Any]) -> TrackerConfig:
    """Return the configuration of the tracker that a live node's parameters describe.

    The node's own parameters are ignored.

    Raises
    ------
    ConfigError
        With every fault.
    """
    of_node = tracker_node.NAMES.union(_OF_EVERY_NODE)
    return resolve(
        {
            name: value
            for name, value in given.items()
            if name not in of_node and not name.startswith("qos_overrides.")
        },
        SystemPlane,
    )


def load(path: Path, tracker: str) -> TrackerConfig:
    """Return the configuration that a parameter file gives the tracker of that full name.

    Raises
    ------
    ConfigError
        If it is not a parameter file or has no section for the tracker, or with every fault of the
        parameters.
    """
    return config(sections.read(path).values(tracker))
