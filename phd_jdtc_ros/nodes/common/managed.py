"""Managed nodes, which may also configure and activate themselves."""

from __future__ import annotations

from typing import Any

from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from phd_jdtc_ros.exit_status import faults_of

from .runtime import RunnableNode


class ManagedNode(LifecycleNode, RunnableNode):
    """A lifecycle node.

    Transitions that the present state does not have are refused; rclpy would end the node.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._fault: Exception | None = None
        self._starting = False
        service = self._service_change_state
        change = service.callback

        def change_state(request: Any, response: Any) -> Any:
            try:
                return change(request, response)
            except Exception as error:  # rclpy's own type for this is private
                self.get_logger().error(f"transition refused: {error}")
                response.success = False
                return response

        service.callback = change_state

    @property
    def phase(self) -> str:
        """The lifecycle state's label, such as ``active``."""
        return str(self._state_machine.current_state[1])

    @property
    def is_active(self) -> bool:
        """Whether the node is active."""
        return self.phase == "active"

    def start(self, autostart: bool) -> None:
        """Configure and activate the node, or log that it waits; raise the fault of a refusal."""
        if not autostart:
            self.get_logger().info("unconfigured; waiting for a transition")
            return
        self._starting = True
        for transition in (self.trigger_configure, self.trigger_activate):
            transition()
            if self._fault is not None:
                raise self._fault
        self._starting = False

    def refuse(self, what: str, fault: Exception) -> TransitionCallbackReturn:
        """Fail a transition, and log the reason, for which its response has no room.

        `start` raises it instead.
        """
        self._fault = fault
        if not self._starting:
            self.get_logger().error(f"{what}: " + "\n".join(faults_of(fault)))
        return TransitionCallbackReturn.FAILURE
