"""For how long counts have not risen, by the wall clock; for warnings that stay for a while."""

from __future__ import annotations

import math
import time

# How long a warning stays after its cause, seconds.
MEMORY_S = 10.0


class Seen:
    """Tells for how long counts have not risen; one that falls has begun again."""

    def __init__(self) -> None:
        self._counts: dict[str, tuple[int, float]] = {}

    def since_s(self, what: str, count: int) -> float:
        """Return for how long a count has been what it is, seconds; for ever from the start on."""
        now = time.monotonic()
        before, risen = self._counts.get(what, (0, -math.inf))
        if count != before:
            risen = now if count else -math.inf
            self._counts[what] = count, risen
        return now - risen

    def rose(self, what: str, count: int) -> bool:
        """Return whether a count has risen within `MEMORY_S`."""
        return self.since_s(what, count) < MEMORY_S
