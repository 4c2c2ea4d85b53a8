# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Finds the package's data files, in the checkout or in the installed package."""

from __future__ import annotations

import os
import sys
import sysconfig
from pathlib import Path

PACKAGE = "phd_jdtc_ros"
SHARE = Path("share", PACKAGE)
# The environment variables that name the profiles' file for Fast DDS 2 and Fast DDS 3.
PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def find(relative: Path) -> Path:
    """Return the path of a file or directory; `relative` is its path in the checkout.

    It is looked for in the working directory, the checkout that the package is imported from, the
    ``share`` directory beside an installed package (of a prefix, a virtual environment or a pip
    target), and in the ament index. If it is nowhere, `relative` is returned.
    """
    home = Path(__file__).resolve().parents[2]
    places = [Path(), home]
    places += [base / SHARE for base in (home, *home.parents)]
    places += [Path(sysconfig.get_path("data")) / SHARE, Path(sys.prefix) / SHARE]
    for place in places:
        if (place / relative).exists():
            return place / relative
    try:
        from ament_index_python.packages import get_package_share_directory

        return Path(get_package_share_directory(PACKAGE)) / relative
    # ROS or the package is not installed, or no workspace is sourced.
    except (ImportError, LookupError, OSError):
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
