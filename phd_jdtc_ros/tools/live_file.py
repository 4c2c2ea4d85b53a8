# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A live tracker's parameters, read by others than the node: launch files, offline tools."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phd_jdtc_ros.core.config import TrackerConfig, resolve
from phd_jdtc_ros.nodes import settings

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
