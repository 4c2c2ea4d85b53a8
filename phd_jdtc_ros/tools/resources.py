# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finds the package's data files, in the checkout or in the installed package."""

from __future__ import annotations

import os
from pathlib import Path

# The environment variables that name the profiles' file for Fast DDS 2 and Fast DDS 3.
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def find(relative: Path) -> Path:
    """Return the path of a file or directory; `relative` is its path in the checkout."""
    if relative.exists():
        return relative
    try:
        from ament_index_python.packages import get_package_share_directory

        return Path(get_package_share_directory("phd_jdtc_ros")) / relative
    except (ImportError, LookupError):  # ROS or the package is not installed
        return relative


def isolation() -> dict[str, str]:
    """Return the environment variables that limit Fast DDS to the loopback interface.

    Empty if the user has chosen a profile, which then stays in force.
    """
    profile = find(Path("config/dds/localhost_only.xml"))
    chosen = [name for name in PROFILE_VARIABLES if name in os.environ]
    if chosen or not profile.exists():
        return {}
    return dict.fromkeys(PROFILE_VARIABLES, str(profile.resolve()))
