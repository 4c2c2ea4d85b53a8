"""Reports on ``/diagnostics`` that the tracker compiles, while its own node does not exist yet.

The first start after an installation compiles for about forty seconds. The node subscribes only
afterwards, so that no scan waits for it and is processed late.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from msg_adapters.encoding import names
from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.core import compilation

from ..common.health import DEPTH, PERIOD_S, Condition, status_of, summary
from ..common.topics import reliable

TEXT = "the tracker is compiling, once for each installation"
# The longest time that the end of the reports may take, seconds.
END_S = 5.0


@contextmanager
def report_compilation(argv: Sequence[str]) -> Iterator[None]:
    """Report each second from the moment that something is compiled until the block ends.

    `argv` includes the ROS arguments, which give the tracker its name.
    """
    ended = threading.Event()
    thread = threading.Thread(target=_report, args=(list(argv), ended), daemon=True)
    compilation.ON_COMPILATION.append(thread.start)
    try:
        yield
    finally:
        compilation.ON_COMPILATION.remove(thread.start)
        ended.set()
        if thread.is_alive():
            thread.join(END_S)


def _report(argv: list[str], ended: threading.Event) -> None:
    """Publish the status until the event; the tracker itself reports faults of its arguments."""
    context = Context()
    rclpy.init(args=argv, context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = Node("tracker", context=context, enable_rosout=False, start_parameter_services=False)
        name = node.get_fully_qualified_name()
        line = status_of(name, "step time", Condition(DiagnosticStatus.STALE, TEXT))
        lines = [summary(name, [line]), line]
        output = node.create_publisher(DiagnosticArray, names.DIAGNOSTICS, reliable(DEPTH))
        is_ended = False
        while not is_ended:
            output.publish(diagnostics.array(node.get_clock().now().nanoseconds, lines))
            is_ended = ended.wait(PERIOD_S)
        node.destroy_node()
    finally:
        context.try_shutdown()
