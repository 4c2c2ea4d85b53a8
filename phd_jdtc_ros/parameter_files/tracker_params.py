"""Reads a live tracker's parameters for launch files and offline tools."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.parameters import tracker_node
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import sections


def config(given: Mapping[str, Any]) -> TrackerConfig:
    """Return the configuration by a node's own parameters; `ConfigError` has every fault."""
    return resolve({k: given[k] for k in given if k not in tracker_node.NAMES}, SystemPlane)


def load(path: Path, tracker: str) -> TrackerConfig:
    """Return a tracker's configuration by a parameter file; `ConfigError` has every fault."""
    return config(sections.read(path).values(tracker))
