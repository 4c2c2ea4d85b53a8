"""Warnings that are logged now and then, each subject by itself.

rclpy throttles by the line of code, so that of several causes that share a line one is logged.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable

from rclpy.impl.rcutils_logger import RcutilsLogger


class ThrottledWarnings:
    """Logs a subject's warnings at most once in a period.

    Parameters
    ----------
    logger : RcutilsLogger
    period_s : float
    clock : callable
        Returns the time, seconds; a steady one, because a clock that is set back would silence it.
    """

    def __init__(
        self,
        logger: RcutilsLogger,
        period_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._logger = logger
        self._period_s = period_s
        self._clock = clock
        self._said_s: dict[Hashable, float] = {}

    def warn(self, subject: Hashable, text: str) -> None:
        """Log a warning, unless one of the subject was logged within the period."""
        now = self._clock()
        if subject in self._said_s and now - self._said_s[subject] < self._period_s:
            return
        self._said_s[subject] = now
        self._logger.warning(text)
