"""Logs what diagnostics say, for those who read the log alone: each cause once, and its end."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.impl.rcutils_logger import RcutilsLogger

# A cause is logged once it has lasted so long: not what a start or a single lost scan brings.
LASTING_S = 5.0
_NUMBERS = re.compile(r"\d+(\.\d+)?")


@dataclass
class _Cause:
    """What a status has said, numbers apart, since when, and whether it is in the log."""

    words: str
    since_s: float
    logged: bool = False


class StatusLog:
    """Logs a status that is not well, once for each cause, and that it is well again.

    Parameters
    ----------
    clock : callable
        Returns the time, seconds; a steady one.
    """

    def __init__(self, logger: RcutilsLogger, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger = logger
        self._clock = clock
        self._causes: dict[str, _Cause] = {}
        self._told: set[str] = set()

    def take(self, statuses: Iterable[DiagnosticStatus]) -> None:
        """Log what is new in statuses."""
        for status in statuses:
            self._take(status)

    def forget(self) -> None:
        """Begin again, as after a time in which nothing was to be well."""
        self._causes.clear()
        self._told.clear()

    def _take(self, status: DiagnosticStatus) -> None:
        name, now_s = status.name, self._clock()
        well = status.level == DiagnosticStatus.OK
        words = "" if well else _NUMBERS.sub("", status.message)
        cause = self._causes.get(name)
        if cause is None or cause.words != words:
            cause = self._causes[name] = _Cause(words, now_s)
        if cause.logged or now_s - cause.since_s < LASTING_S:
            return
        cause.logged = True
        if well:
            if name in self._told:
                self._told.remove(name)
                self._logger.info(f"{name}: {status.message} again")
            return
        self._told.add(name)
        text = f"{name}: {status.message}"
        if status.level == DiagnosticStatus.ERROR:
            self._logger.error(text)
        else:
            self._logger.warning(text)
