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

"""Exit statuses of the executables, and how they say why they end."""

from __future__ import annotations

import sys

from msg_adapters.errors import BagError
from phd_jdtc_ros.core.config import ConfigError

OK, FAILED, USAGE, CORRUPT, INTERRUPTED = 0, 1, 2, 3, 130


def fail(name: str, error: Exception) -> int:
    """Print why an executable cannot go on, a line a fault, and return its exit status."""
    faults = error.faults if isinstance(error, ConfigError) else (str(error),)
    for fault in faults:
        print(f"{name}: {fault}", file=sys.stderr)
    return CORRUPT if isinstance(error, BagError) and error.corrupt else USAGE
