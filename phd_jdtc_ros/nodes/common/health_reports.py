"""Publishes a node's health once a second, and logs what it warns of."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from msg_adapters import diagnostics, names

from .throttled import ThrottledWarnings

PERIOD_S = 1.0
DEPTH = 10


class HealthReports:
    """Publishes statuses on ``/diagnostics`` by the wall clock.

    Simulated time may stop, and with it what is to be warned of.

    Parameters
    ----------
    node : Node
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
