"""Lock-step: a scan is published after the estimate of the previous scan has arrived."""

from __future__ import annotations

# A tracker may publish an estimate only after a later stamp (radars without a common scan). So
# without a reply for PATIENCE_S further stamps may be published, up to MAX_OUTSTANDING.
PATIENCE_S = 1.0
MAX_OUTSTANDING = 4
GIVE_UP_S = 30.0


class LockStep:
    """The published stamps that wait for a reply.

    Times are seconds of one monotonic clock.

    `delay_s` is the largest age of a reply relative to its stamp, in the bag's time. Until the bag
    has played so long no reply is awaited, because the tracker may still wait for other radars.
    """

    def __init__(self, delay_s: float = 0.0) -> None:
        self._delay_ns = round(delay_s * 1e9)
        self._outstanding: list[int] = []
        self._first_ns: int | None = None
        self._since_s = 0.0
        self._running_since_s = 0.0

    def begin(self) -> None:
        """Drop all awaited stamps, because the bag has jumped."""
        self._outstanding.clear()
        self._first_ns = None

    def restart(self, now_s: float) -> None:
        """Restart the time until giving up: during a pause no other stamp could be published."""
        self._running_since_s = now_s

    def expect(self, stamp_ns: int, now_s: float) -> None:
        """Await the estimate of a stamp."""
        self._first_ns = stamp_ns if self._first_ns is None else self._first_ns
        if stamp_ns - self._delay_ns < self._first_ns:
            return
        if not self._outstanding:
            self._since_s = now_s
        self._outstanding.append(stamp_ns)

    def receive(self, stamp_ns: int, now_s: float) -> None:
        """Take in an estimate, which is the reply to its own stamp and all earlier ones.

        An estimate of a stamp after the awaited ones is a late one from before `begin`, for
        instance from the end of a bag that has started again. It is ignored.
        """
        if not self._outstanding or stamp_ns > self._outstanding[-1]:
            return
        while self._outstanding and self._outstanding[0] <= stamp_ns + self._delay_ns:
            self._outstanding.pop(0)
            self._since_s = now_s

    def may_follow(self, now_s: float) -> bool:
        """Return whether the next stamp may be published."""
        return not self._outstanding or (
            self._waited_s(now_s) > PATIENCE_S and len(self._outstanding) < MAX_OUTSTANDING
        )

    def is_settled(self, now_s: float) -> bool:
        """Return whether no more replies are expected unless another stamp is published."""
        return not self._outstanding or self._waited_s(now_s) > PATIENCE_S

    def has_timed_out(self, now_s: float) -> bool:
        """Return whether there has been no reply for `GIVE_UP_S`."""
        waited_s = now_s - max(self._since_s, self._running_since_s)
        return bool(self._outstanding) and waited_s > GIVE_UP_S

    def _waited_s(self, now_s: float) -> float:
        return now_s - self._since_s
