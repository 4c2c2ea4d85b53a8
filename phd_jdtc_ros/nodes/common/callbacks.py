"""Timers by the wall clock, and trigger services."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.timer import Timer
from std_srvs.srv import Trigger


def steady_timer(
    node: Node, period_s: float, callback: Callable[[], None], autostart: bool = True
) -> Timer:
    """Return a timer by the wall clock, which runs on when simulated time stops."""
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period_s, callback, clock=clock, autostart=autostart)


def serve(node: Node, name: str, action: Callable[[], tuple[bool, str]]) -> None:
    """Offer the service ``~/NAME``; `action` returns whether it succeeded, and the message."""

    def reply(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = action()
        return response

    node.create_service(Trigger, f"~/{name}", reply)
