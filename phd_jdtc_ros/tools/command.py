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

"""What the offline executables share: arguments, and one way to end."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from msg_adapters.bag import BagError
from phd_jdtc_ros.core.config import ConfigError, TrackerConfig
from phd_jdtc_ros.exits import INTERRUPTED, USAGE, fail

from . import live_file, params_file

# OSPA's c (metres) and p where nothing else is asked for.
CUTOFF, ORDER = 1000.0, 2.0


def guarded(name: str, work: Callable[[], int]) -> int:
    """Run `work` and turn what users can cause into one line each and an exit status."""
    try:
        return work()
    except (ConfigError, BagError) as error:
        return fail(name, error)
    except OSError as error:  # a path that cannot be written, a full disk
        where = f"{error.filename}: " if error.filename else ""
        print(f"{name}: {where}{error.strerror or error}", file=sys.stderr)
        return USAGE
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        return INTERRUPTED


def add_parameter_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that set tracker parameters."""
    parser.add_argument(
        "--scenario",
        type=Path,
        help="scenario file, whose parameters are used; the reference scenario if absent",
    )
    parser.add_argument(
        "--params-file", type=Path, action="append", default=[], help="ROS parameter file"
    )
    parser.add_argument(
        "-p", dest="assignments", action="append", default=[], metavar="NAME:=VALUE"
    )


def tracker_config(arguments: argparse.Namespace) -> TrackerConfig:
    """Return the configuration that the parameter arguments ask for."""
    given: dict[str, Any] = {}
    if arguments.scenario is not None:
        given = params_file.scenario_parameters(params_file.load_yaml(arguments.scenario))
    paths: Sequence[Path] = arguments.params_file
    given |= params_file.from_arguments(paths, arguments.assignments)
    # A live tracker's file may be given too.
    return live_file.config(given)
