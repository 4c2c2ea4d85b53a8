"""What the health of all nodes is made of: usual intervals, what was lately, reports and logs.

Ages are measured by the wall clock, because what has died sends no more stamps.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from statistics import median

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from msg_adapters import diagnostics, names

# How long a warning stays after its cause, seconds.
WARNING_MEMORY_S = 10.0
# What happens within this time is kept together, seconds.
STEP_S = 0.1
# Number of latest intervals whose median is the usual one.
KEPT_INTERVALS = 9
PERIOD_S = 1.0
DEPTH = 10


class Rhythm:
    """The usual interval between repeated events: the median of the latest ones.

    Parameters
    ----------
    first_guess_s : float
        Counts as one interval, so that the first two events arriving together are not taken as
        the usual interval.
    """

    def __init__(self, first_guess_s: float) -> None:
        self._intervals = deque([first_guess_s], maxlen=KEPT_INTERVALS)
        self._last_s: float | None = None

    def beat(self, now_s: float) -> None:
        """Record an event."""
        if self._last_s is not None and now_s > self._last_s:
            self._intervals.append(now_s - self._last_s)
        self._last_s = now_s

    def pause(self) -> None:
        """Let the next event begin a new series, so that the interval before it does not count."""
        self._last_s = None

    @property
    def interval_s(self) -> float:
        """The usual interval, seconds."""
        return median(self._intervals)


class Lately:
    """How much was counted within the last `WARNING_MEMORY_S`, to a `STEP_S`."""

    def __init__(self) -> None:
        self._counts: deque[tuple[float, int]] = deque()

    def add(self, now_s: float, count: int = 1) -> None:
        """Count something that has just happened."""
        self.count(now_s)
        # Together, so that a flood of faults takes no memory.
        if self._counts and now_s - self._counts[-1][0] < STEP_S:
            now_s, before = self._counts.pop()
            count += before
        self._counts.append((now_s, count))

    def count(self, now_s: float) -> int:
        """Return how much was counted lately."""
        while self._counts and now_s - self._counts[0][0] >= WARNING_MEMORY_S:
            self._counts.popleft()
        return sum(count for _, count in self._counts)


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
        """Return whether a count has risen within `WARNING_MEMORY_S`."""
        return self.since_s(what, count) < WARNING_MEMORY_S


class ThrottledWarnings:
    """Logs a subject's warnings at most once in a period.

    Parameters
    ----------
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


class HealthReports:
    """Publishes statuses on ``/diagnostics`` by the wall clock.

    Simulated time may stop, and with it what is to be warned of.

    Parameters
    ----------
    statuses : callable
        Returns them.
    warnings : ThrottledWarnings
        Logs those that warn.
    """

    def __init__(
        self,
        node: Node,
        statuses: Callable[[], Sequence[DiagnosticStatus]],
        warnings: ThrottledWarnings,
    ) -> None:
        self._node = node
        self._statuses = statuses
        self._warnings = warnings
        qos = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)
        self._output = node.create_publisher(DiagnosticArray, names.DIAGNOSTICS, qos)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(PERIOD_S, self._publish, clock=steady)

    def _publish(self) -> None:
        statuses = self._statuses()
        for status in statuses:
            if status.level in (DiagnosticStatus.WARN, DiagnosticStatus.ERROR):
                self._warnings.warn(status.name, f"{status.name}: {status.message}")
        stamp_ns = self._node.get_clock().now().nanoseconds
        self._output.publish(diagnostics.array(stamp_ns, statuses))
