"""Exit statuses of the executables, and the messages with which they end."""

from __future__ import annotations

import argparse
import sys
from typing import NoReturn

from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.quoting import short

# CORRUPT also means that less than half of the input could be used.
OK, FAILED, USAGE, CORRUPT, INTERRUPTED = 0, 1, 2, 3, 130


class ArgumentParser(argparse.ArgumentParser):
    """A parser of command lines that quotes at most a part of a long argument."""

    def error(self, message: str) -> NoReturn:
        """Print a fault and end with status 2."""
        super().error(short(message))


def faults_of(error: Exception) -> tuple[str, ...]:
    """Return an error's text, a line for each fault, without the middle of long quotations."""
    if isinstance(error, ConfigError):
        return error.faults
    return (short(" ".join(str(error).split())),)


def fail(name: str, error: Exception) -> int:
    """Print why an executable ends, a line for each fault, and return its exit status."""
    for fault in faults_of(error):
        print(f"{name}: {fault}", file=sys.stderr)
    return CORRUPT if isinstance(error, BagError) and error.corrupt else USAGE
