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

"""The command line of a node that takes ROS arguments alone."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from rclpy.utilities import remove_ros_args

_EXAMPLES = "--ros-args -p NAME:=VALUE, --params-file FILE, -r FROM:=TO, -r __ns:=/NAME"


def check(name: str, purpose: str, argv: Sequence[str]) -> None:
    """Show the help if it is asked for, and refuse what is no ROS argument.

    rclpy ignores such words: a parameter file without ``--ros-args`` before it changes nothing.

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
