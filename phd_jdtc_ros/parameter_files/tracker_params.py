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
    """Return the configuration by a live node's parameters; `ConfigError` has every fault."""
    return resolve(without_node(given), SystemPlane)


def without_node(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a live node's parameters without those that only a live node uses."""
    return {
        name: value
        for name, value in given.items()
        if name not in tracker_node.NAMES and sections.is_own(name)
    }


def load(path: Path, tracker: str) -> TrackerConfig:
    """Return a tracker's configuration by a parameter file; `ConfigError` has every fault."""
    return config(sections.read(path).values(tracker))
