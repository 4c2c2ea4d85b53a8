"""Logs the statuses of a node: each cause of a warning once, and its end."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.impl.rcutils_logger import RcutilsLogger

# A cause is logged once it has lasted this time, which a start or a single lost scan does not.
LASTING_S = 5.0
_NUMBERS = re.compile(r"\d+(\.\d+)?")


@dataclass
class _Cause:
    """A status's message without its numbers, and the time since when it has lasted, seconds."""

    words: str
    since_s: float
    logged: bool = False


class StatusLog:
    """Logs each cause for which a status is not OK once, and the return to OK."""

    def __init__(self, logger: RcutilsLogger, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger = logger
        self._clock = clock
        self._causes: dict[str, _Cause] = {}
        self._warned: set[str] = set()

    def take(self, statuses: Iterable[DiagnosticStatus]) -> None:
        """Log the changes since the previous statuses."""
        for status in statuses:
            self._take(status)

    def clear(self) -> None:
        """Forget all causes, because the node was not active."""
        self._causes.clear()
        self._warned.clear()

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
        text = f"{name}: {status.message}"
        if not well:
            self._warned.add(name)
            # There are two calls, because rclpy allows one severity per place of a call.
            if status.level == DiagnosticStatus.ERROR:
                self._logger.error(text)
            else:
                self._logger.warning(text)
        elif name in self._warned:
            self._warned.remove(name)
            self._logger.info(f"{text} again")
