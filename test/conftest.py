# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

import os

# Before anything imports rclpy: tests talk on this machine only, apart from other ROS processes.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

from robustness.domains import Domain

# Never released: it is this process's until that ends.
os.environ["ROS_DOMAIN_ID"] = str(Domain().number)

import pytest
from hypothesis import settings

settings.register_profile("project", deadline=None)
settings.load_profile("project")

LIVE = {"processes", "executables", "peer", "demo"}


def pytest_collection_modifyitems(items):
    """Mark what starts nodes or talks to them by a fixture, so that nobody has to think of it."""
    for item in items:
        # A launch test has no fixtures.
        if LIVE & {*getattr(item, "fixturenames", ())}:
            item.add_marker(pytest.mark.live)
