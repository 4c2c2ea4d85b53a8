# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the package brings beside its code, of the checkout or of the installed package."""

from __future__ import annotations

import os
from pathlib import Path

# What Fast DDS 2 and Fast DDS 3 call the file of profiles.
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def find(here: Path) -> Path:
    """Return where a file or a directory is that the checkout has under `here`."""
    if here.exists():
        return here
    try:
        from ament_index_python.packages import get_package_share_directory

        return Path(get_package_share_directory("phd_jdtc_ros")) / here
    except (ImportError, LookupError):  # no ROS installation, or the package is not in it
        return here


def isolation() -> dict[str, str]:
    """Return the environment in which Fast DDS uses the loopback interface alone.

    A profile that the user has chosen stays in force.
    """
    profile = find(Path("config/dds/localhost_only.xml"))
    chosen = [name for name in PROFILE_VARIABLES if name in os.environ]
    if chosen or not profile.exists():
        return {}
    return dict.fromkeys(PROFILE_VARIABLES, str(profile.resolve()))
