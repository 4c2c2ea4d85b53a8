"""The bag's time, driven by the wall clock."""

from __future__ import annotations

import time


class BagClock:
    """A replay's position in its bag as a log time; `rate` is relative to the recording."""

    def __init__(self, rate: float, now_ns: int) -> None:
        self._rate = rate
        self.now_ns = now_ns
        self.restart()

    def restart(self) -> None:
        """Let the bag's time run on from its present value."""
        self._wall_start_s = time.monotonic()
        self._start_ns = self.now_ns

    def is_due(self, log_time_ns: int) -> bool:
        """Return whether a log time is due; if it is not, advance the clock towards it."""
        elapsed_ns = (time.monotonic() - self._wall_start_s) * 1e9 * self._rate
        due = log_time_ns - self._start_ns <= elapsed_ns
        if not due:
            self.now_ns = self._start_ns + int(elapsed_ns)
        return bool(due)
