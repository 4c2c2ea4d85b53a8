"""Health of a node: usual intervals, recent rises of counts, and reports on ``/diagnostics``.

Ages are measured by the wall clock, because a dead publisher sends no more stamps.
"""

from __future__ import annotations

import math
import re
import time
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics

from .runtime import serve, steady_timer
from .topics import reliable

# A cause is logged only after this time, so that a start or a single lost scan is not logged.
LASTING_S = 5.0
_NUMBERS = re.compile(r"\d+(\.\d+)?")

# Time for which a warning stays after its cause, seconds.
WARNING_MEMORY_S = 10.0
# A warning whose cause persists is logged at most once in this time, seconds.
WARNING_PERIOD_S = 5.0
PERIOD_S = 1.0
# Interval between checks of a node's state, whose change is published at once, seconds.
CHECK_PERIOD_S = 0.1
DEPTH = 10
# The line of the worst of all statuses, the service that tells it, and its text without a fault.
SUMMARY, SERVICE, ALL_WELL = "summary", "health", "all is well"


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
        is_ok = status.level == DiagnosticStatus.OK
        words = "" if is_ok else _NUMBERS.sub("", status.message)
        cause = self._causes.get(name)
        if cause is None or cause.words != words:
            cause = self._causes[name] = _Cause(words, now_s)
        if cause.logged or now_s - cause.since_s < LASTING_S:
            return
        cause.logged = True
        text = f"{name}: {status.message}"
        if not is_ok:
            self._warned.add(name)
            # There are two calls, because rclpy allows one severity per place of a call.
            if status.level == DiagnosticStatus.ERROR:
                self._logger.error(text)
            else:
                self._logger.warning(text)
        elif name in self._warned:
            self._warned.remove(name)
            self._logger.info(f"{text} again")


class Condition(NamedTuple):
    """What a status says."""

    level: bytes
    message: str


def first(*conditions: tuple[bytes, object, str]) -> Condition:
    """Return level and message of the first condition whose second member is true."""
    return next(Condition(level, text) for level, holds, text in conditions if holds)


def status_of(
    node: str,
    line: str,
    condition: Condition,
    values: Mapping[str, object] | None = None,
    hardware_id: str = "",
) -> DiagnosticStatus:
    """Return a status of a node with this full name, which is the hardware unless another is."""
    name = names.health(line, node)
    return diagnostics.status(name, values or {}, *condition, hardware_id or node)


def summary(node: str, statuses: Sequence[DiagnosticStatus]) -> DiagnosticStatus:
    """Return the worst of a node's statuses: its lines, its message, and the other wrong lines."""
    # Levels from the best to the worst: what is silent may be more than a warning, and is no error.
    severity = (
        DiagnosticStatus.OK,
        DiagnosticStatus.WARN,
        DiagnosticStatus.STALE,
        DiagnosticStatus.ERROR,
    )
    worst = max(statuses, key=lambda each: severity.index(each.level))
    if worst.level == DiagnosticStatus.OK:
        return status_of(node, SUMMARY, Condition(worst.level, ALL_WELL))
    wrong = [each for each in statuses if each.level != DiagnosticStatus.OK]
    lines = [(each.message, each.name.removeprefix(names.health("", node))) for each in wrong]
    alike = [line for message, line in lines if message == worst.message]
    others = [line for message, line in lines if message != worst.message]
    rest = f"; not OK either: {', '.join(others)}" if others else ""
    text = f"{', '.join(alike)}: {worst.message}{rest}"
    return status_of(node, SUMMARY, Condition(worst.level, text))


class Rhythm:
    """The usual interval between events: the median of nine, of the latest and a first guess."""

    def __init__(self, first_guess_s: float) -> None:
        self._intervals = deque([first_guess_s], maxlen=9)
        self._last_s: float | None = None

    def beat(self, now_s: float) -> None:
        """Record an event."""
        if self._last_s is not None and now_s > self._last_s:
            self._intervals.append(now_s - self._last_s)
        self._last_s = now_s

    def begin_series(self) -> None:
        """Let the next event begin a new series, so that the interval before it does not count."""
        self._last_s = None

    @property
    def interval_s(self) -> float:
        """The usual interval, seconds."""
        return median(self._intervals)


@dataclass
class _Count:
    value: int = 0
    last_rise_s: float = -math.inf
    rises: deque[tuple[float, int]] = field(default_factory=deque)


class Rises:
    """Rises of counts that are read regularly; a fall means that a count restarted at zero."""

    def __init__(self, memory_s: float = WARNING_MEMORY_S) -> None:
        self._memory_s = memory_s
        self._counts: dict[str, _Count] = {}

    def recent(self, name: str, value: int, now_s: float) -> int:
        """Return by how much a count has risen within the last `memory_s`."""
        return sum(rise for _, rise in self._read(name, value, now_s).rises)

    def unchanged_s(self, name: str, value: int, now_s: float) -> float:
        """Return the time since a count last rose, seconds; infinite before its first rise."""
        return now_s - self._read(name, value, now_s).last_rise_s

    def _read(self, name: str, value: int, now_s: float) -> _Count:
        count = self._counts.setdefault(name, _Count())
        if value < count.value:
            count = self._counts[name] = _Count()
        if value > count.value:
            count.rises.append((now_s, value - count.value))
            count.value, count.last_rise_s = value, now_s
        while count.rises and now_s - count.rises[0][0] >= self._memory_s:
            count.rises.popleft()
        return count


class ThrottledWarnings:
    """Logs a subject's warnings at most once in `WARNING_PERIOD_S` of a steady clock, seconds."""

    def __init__(self, logger: RcutilsLogger, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger = logger
        self._clock = clock
        self._logged_s: dict[Hashable, float] = {}

    def warn(self, subject: Hashable, text: str) -> None:
        """Log a warning, unless one of the subject was logged within the period."""
        now_s = self._clock()
        if now_s - self._logged_s.get(subject, -math.inf) >= WARNING_PERIOD_S:
            self._logged_s[subject] = now_s
            self._logger.warning(text)


class HealthReports:
    """Publishes a node's statuses on ``/diagnostics`` each second, and logs causes of warnings.

    The first is the `summary` of the others, which the service ``~/health`` tells too.
    `active` returns whether the node works, so that its warnings are logged, and `state` a value
    whose change is published at once.
    """

    def __init__(
        self,
        node: Node,
        statuses: Callable[[], Sequence[DiagnosticStatus]],
        active: Callable[[], bool] = lambda: True,
        state: Callable[[], Hashable] = lambda: None,
    ) -> None:
        self._node = node
        self._statuses, self._active, self._state = statuses, active, state
        self._log = StatusLog(node.get_logger())
        self._published: tuple[Hashable, float] = (None, -math.inf)
        self._output = node.create_publisher(DiagnosticArray, names.DIAGNOSTICS, reliable(DEPTH))
        steady_timer(node, CHECK_PERIOD_S, self._check)
        serve(node, SERVICE, self._answer)

    def _summary(self, statuses: Sequence[DiagnosticStatus]) -> DiagnosticStatus:
        return summary(self._node.get_fully_qualified_name(), statuses)

    def _answer(self) -> tuple[bool, str]:
        """Return whether all is well, and the summary."""
        found = self._summary(self._statuses())
        return found.level == DiagnosticStatus.OK, found.message

    def _check(self) -> None:
        now_s, state = time.monotonic(), self._state()
        before, published_s = self._published
        if state == before and now_s - published_s < PERIOD_S:
            return
        self._published = state, now_s
        statuses = self._statuses()
        if self._active():
            self._log.take(statuses)
        else:
            self._log.clear()
        stamp_ns = self._node.get_clock().now().nanoseconds
        self._output.publish(diagnostics.array(stamp_ns, [self._summary(statuses), *statuses]))
