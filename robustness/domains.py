# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS domains that nobody else on this machine uses."""

from __future__ import annotations

import fcntl
import itertools
import os
import socket
import tempfile
from pathlib import Path

# Above these the ports of a domain may be given to any program.
DOMAINS = range(1, 101)

_turns = itertools.count()


class Domain:
    """A domain of this process's own, until it is released or the process ends.

    Two of these never share one: each holds the lock on a file in the temporary folder, which ends
    with the process, however it ends. ROS processes that know nothing of this are seen by their
    ports.

    Attributes
    ----------
    number : int

    Raises
    ------
    RuntimeError
        If every domain is taken.
    """

    def __init__(self) -> None:
        # Not the same again and again: a process that was killed may still be known in the last.
        first = os.getpid() + 7 * next(_turns)
        for offset in range(len(DOMAINS)):
            self.number = DOMAINS[(first + offset) % len(DOMAINS)]
            lock = _locked(self.number)
            if lock is None:
                continue
            if _ports_free(self.number):
                self._lock = lock
                return
            os.close(lock)
        raise RuntimeError(f"the domains {DOMAINS[0]} to {DOMAINS[-1]} are all taken")

    def release(self) -> None:
        """Leave it to others."""
        os.close(self._lock)


def _locked(domain: int) -> int | None:
    """Return an open file with the lock of a domain, or None if another has it."""
    path = Path(tempfile.gettempdir()) / f"phd_jdtc_ros_domain_{domain}.lock"
    try:
        lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except PermissionError:  # another user's
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        return None
    return lock


def _ports_free(domain: int) -> bool:
    """Return whether nobody listens where the first participant of a domain does."""
    # RTPS 2.3, Sec. 9.6.1.1: discovery by multicast, and by unicast.
    for port in (7400 + 250 * domain, 7410 + 250 * domain):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", port))
            except OSError:
                return False
    return True
