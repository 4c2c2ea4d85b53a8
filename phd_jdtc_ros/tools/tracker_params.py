# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A live tracker's parameters, read by others than the node: launch files, offline tools."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phd_jdtc_ros.core.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.nodes.tracker import settings

from . import params_file

# What every node has, by rclpy.
_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")


def config(given: Mapping[str, Any]) -> TrackerConfig:
    """Return the tracker that a live node's parameters describe.

    What only the node has does not matter.

    Raises
    ------
    ConfigError
        With every fault of what they describe.
    """
    of_node = settings.NAMES.union(_OF_EVERY_NODE)
    return resolve(
        {
            name: value
            for name, value in given.items()
            if name not in of_node and not name.startswith("qos_overrides.")
        }
    )


def load(path: Path) -> TrackerConfig:
    """Return the tracker that a file describes.

    Raises
    ------
    ConfigError
        If it is no parameter file, or with every fault of what it describes.
    """
    return config(params_file.load(path))
