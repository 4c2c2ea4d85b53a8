"""CPU time of a tracker's steps, measured in the same way live and offline."""

from __future__ import annotations

import time


class StepClock:
    """Measures this thread's CPU time of each step: decoding, tracking and output of a scan.

    The time within its ``with`` blocks counts. Work that steps no scan, such as a report that only
    completes a part of one, counts for the next step.
    """

    def __init__(self) -> None:
        self._cpu_s = self._begin_s = 0.0

    def __enter__(self) -> StepClock:
        self._begin_s = time.thread_time()
        return self

    def __exit__(self, *raised: object) -> None:
        self._cpu_s += time.thread_time() - self._begin_s

    def take_ms(self) -> float:
        """Return the CPU time since the last call, milliseconds; call it once for each step."""
        now_s = time.thread_time()
        taken_s = self._cpu_s + now_s - self._begin_s
        self._cpu_s, self._begin_s = 0.0, now_s
        return 1e3 * taken_s

    def discard(self) -> None:
        """Forget the time so far, because no step follows it."""
        self._cpu_s, self._begin_s = 0.0, time.thread_time()
