# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""For how long counts have not risen, by the wall clock; for warnings that stay for a while."""

from __future__ import annotations

import time

# How long a warning stays after its cause, seconds.
MEMORY_S = 10.0


class Seen:
    """Tells for how long counts have not risen."""

    def __init__(self) -> None:
        self._counts: dict[str, tuple[int, float]] = {}

    def since_s(self, what: str, count: int) -> float:
        """Return for how long a count has been what it is, seconds."""
        now = time.monotonic()
        before, changed = self._counts.get(what, (0, -1e9))
        if count != before:
            self._counts[what] = count, now
            return 0.0
        return now - changed

    def rose(self, what: str, count: int) -> bool:
        """Return whether a count has risen within `MEMORY_S`."""
        return self.since_s(what, count) < MEMORY_S
