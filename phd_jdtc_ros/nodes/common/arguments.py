# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command line of a node that takes only ROS arguments."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from rclpy.utilities import remove_ros_args

_EXAMPLES = "--ros-args -p NAME:=VALUE, --params-file FILE, -r FROM:=TO, -r __ns:=/NAME"


def check(name: str, purpose: str, argv: Sequence[str]) -> None:
    """Show the help if it is asked for, and refuse arguments that are not ROS arguments.

    rclpy ignores them silently: a parameter file without ``--ros-args`` before it has no effect.

    Raises
    ------
    SystemExit
        With status 0 after the help, and with 2 after a refusal.
    """
    parser = argparse.ArgumentParser(
        name,
        usage="%(prog)s [-h] [--ros-args ...]",
        description=purpose,
        epilog=f"ROS arguments are, for instance: {_EXAMPLES}",
    )
    parser.parse_args(remove_ros_args([name, *argv])[1:])
