"""How busy the tracker is, by the wall clock.

CPU time would say nothing on a machine whose other processes take the processor.
"""

from __future__ import annotations

from collections import deque


class Load:
    """The time that the tracker has worked, in all and lately.

    Parameters
    ----------
    window_s : float
        What is lately.

    Attributes
    ----------
    worked_s : float
        In all.
    """

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._spans: deque[tuple[float, float]] = deque()
        self.worked_s = 0.0

    def add(self, begin_s: float, end_s: float) -> None:
        """Record work that has just ended."""
        self.worked_s += end_s - begin_s
        self._spans.append((begin_s, end_s))
        self._forget(end_s)

    def share(self, now_s: float) -> float:
        """Return the share of the window up to now in which the tracker worked, 0 to 1."""
        self._forget(now_s)
        since = now_s - self._window_s
        return sum(end - max(begin, since) for begin, end in self._spans) / self._window_s

    def _forget(self, now_s: float) -> None:
        while self._spans and self._spans[0][1] <= now_s - self._window_s:
            self._spans.popleft()
