"""Reserves ROS domains that no other process on this machine uses."""

from __future__ import annotations

import fcntl
import itertools
import os
import socket
import tempfile
from pathlib import Path

# The ports of higher domains are in the range that the system gives to any program.
DOMAINS = range(1, 101)

_requests = itertools.count()


class Domain:
    """A domain reserved for this process, until it is released or the process ends.

    Each holds the lock of a file in the temporary folder, which is released when the process ends
    in any way. ROS processes that do not use these locks are detected by their ports.
    """

    def __init__(self) -> None:
        # Each starts at another domain, because the last may still list a process that was killed.
        first = os.getpid() + 7 * next(_requests)
        for offset in range(len(DOMAINS)):
            self.number = DOMAINS[(first + offset) % len(DOMAINS)]
            lock = _lock(self.number)
            if lock is None:
                continue
            if _ports_free(self.number):
                self._lock = lock
                return
            os.close(lock)
        raise RuntimeError(f"the domains {DOMAINS[0]} to {DOMAINS[-1]} are all taken")

    def release(self) -> None:
        """Release the domain."""
        os.close(self._lock)


def _lock(domain: int) -> int | None:
    """Return an open file that holds the lock of a domain, or None if another process has it."""
    path = Path(tempfile.gettempdir()) / f"phd_jdtc_ros_domain_{domain}.lock"
    try:
        lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except PermissionError:  # The file is another user's
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        return None
    return lock


def _ports_free(domain: int) -> bool:
    """Return whether the ports of a domain's first participant are free."""
    # RTPS 2.3, Sec. 9.6.1.1: discovery by multicast, and by unicast.
    for port in (7400 + 250 * domain, 7410 + 250 * domain):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", port))
            except OSError:
                return False
    return True
