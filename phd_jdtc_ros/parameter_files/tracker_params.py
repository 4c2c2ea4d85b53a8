"""Reads a live tracker's parameters for launch files and offline tools."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.parameters import tracker_node
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import sections

# The node's own parameters, and the parameters that rclpy gives every node.
_OF_NODE = tracker_node.NAMES.union(("use_sim_time", "start_type_description_service"))


def config(given: Mapping[str, Any]) -> TrackerConfig:
    """Return the configuration by a live node's parameters; `ConfigError` has every fault."""
    ignored = {name for name in given if name in _OF_NODE or name.startswith("qos_overrides.")}
    return resolve({k: given[k] for k in given if k not in ignored}, SystemPlane)


def load(path: Path, tracker: str) -> TrackerConfig:
    """Return a tracker's configuration by a parameter file; `ConfigError` has every fault."""
    return config(sections.read(path).values(tracker))
