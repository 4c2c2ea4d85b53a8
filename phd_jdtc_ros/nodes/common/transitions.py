"""Lifecycle transitions that are requested when the state does not have them."""

from __future__ import annotations

from typing import Any

from rclpy.lifecycle import LifecycleNode


def guard(node: LifecycleNode) -> None:
    """Refuse transitions that the present state does not have; rclpy would end the node."""
    service = node._service_change_state
    change = service.callback

    def guarded(request: Any, response: Any) -> Any:
        try:
            return change(request, response)
        except Exception as error:  # rclpy's own type for this is private
            node.get_logger().error(f"transition refused: {error}")
            response.success = False
            return response

    service.callback = guarded
