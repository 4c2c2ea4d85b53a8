# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exit statuses of the executables, and how they say why they end."""

from __future__ import annotations

import sys

from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.core.configuration.schema import ConfigError

OK, FAILED, USAGE, CORRUPT, INTERRUPTED = 0, 1, 2, 3, 130


def fail(name: str, error: Exception) -> int:
    """Print why an executable cannot go on, a line a fault, and return its exit status."""
    faults = error.faults if isinstance(error, ConfigError) else (str(error),)
    for fault in faults:
        print(f"{name}: {fault}", file=sys.stderr)
    return CORRUPT if isinstance(error, BagError) and error.corrupt else USAGE
