# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lock-step: a scan goes out once the estimate of the one before has come back."""

from __future__ import annotations

# An estimate may be held back until a later stamp comes (radars without a common scan), so after
# this long a few more stamps are allowed out.
PATIENCE_S = 1.0
MOST_OUTSTANDING = 4
GIVE_UP_S = 30.0


class LockStep:
    """What has been published and not been answered yet.

    Times are seconds by one monotonic clock.
    """

    def __init__(self) -> None:
        self._outstanding: list[int] = []
        self._since_s = 0.0
        self._running_since_s = 0.0

    def begin(self) -> None:
        """Await nothing: what comes next is not what followed so far."""
        self._outstanding.clear()

    def run_on(self, now_s: float) -> None:
        """Count from now on until giving up: in a pause no other stamp could go out."""
        self._running_since_s = now_s

    def published(self, stamp_ns: int, now_s: float) -> None:
        """Await the estimate of a stamp."""
        if not self._outstanding:
            self._since_s = now_s
        self._outstanding.append(stamp_ns)

    def answered(self, stamp_ns: int, now_s: float) -> None:
        """Take in an estimate: it answers its stamp and those before it.

        One of a stamp that is not awaited is a late one from before `begin`, as from the end of a
        bag that starts again, and answers nothing.
        """
        if not self._outstanding or stamp_ns > self._outstanding[-1]:
            return
        while self._outstanding and self._outstanding[0] <= stamp_ns:
            self._outstanding.pop(0)
            self._since_s = now_s

    def may_follow(self, now_s: float) -> bool:
        """Return whether the next stamp may go out."""
        return not self._outstanding or (
            self._waited_s(now_s) > PATIENCE_S and len(self._outstanding) < MOST_OUTSTANDING
        )

    def settled(self, now_s: float) -> bool:
        """Return whether no more answers are to be expected without another stamp."""
        return not self._outstanding or self._waited_s(now_s) > PATIENCE_S

    def hopeless(self, now_s: float) -> bool:
        """Return whether there has been no answer for so long that there will be none."""
        waited_s = now_s - max(self._since_s, self._running_since_s)
        return bool(self._outstanding) and waited_s > GIVE_UP_S

    def _waited_s(self, now_s: float) -> float:
        return now_s - self._since_s
