"""Running one node: start, spin, stop, exit status; managed nodes, timers and trigger services.

Signals only set a flag that the spin loop reads. So a stop never interrupts a scan, a second signal
has no effect, and a signal never causes a traceback.
"""

from __future__ import annotations

import gc
import re
import signal
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer
from rclpy.utilities import try_shutdown
from std_srvs.srv import Trigger

from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import FAILED, OK, fail, faults_of
from phd_jdtc_ros.parameter_files import yaml_files


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


def serve_values(
    node: Node, name: str, action: Callable[[Sequence[Any]], tuple[bool, str]]
) -> None:
    """Offer the service ``~/NAME`` with named values; `action` returns as that of `serve` does.

    No standard interface has a text or a number to ask with but the one that sets parameters.
    """

    def reply(request: Any, response: Any) -> Any:
        response.result.successful, response.result.reason = action(request.parameters)
        return response

    node.create_service(SetParametersAtomically, f"~/{name}", reply)


class RunnableNode(Node):
    """A node that `run` runs until its exit status, None at first, is set."""

    exit_status: int | None = None

    def close(self) -> None:
        """Finish all output, once, however the node ended; may set the exit status."""


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
            except Exception as error:  # Its own type is private to rclpy.
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


class StopRequest:
    """A flag that SIGINT and SIGTERM set, from its creation on."""

    def __init__(self) -> None:
        self.made = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._handle)

    def _handle(self, *_: object) -> None:
        self.made = True

    def ignore_further(self) -> None:
        """Ignore signals for good: the interpreter's teardown would restore their defaults."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)


def run(name: str, make_node: Callable[[], RunnableNode], argv: Sequence[str]) -> int:
    """Run a node until it ends or a signal stops it, and return the exit status.

    `make_node` is called after the initialisation of ROS. `argv` includes the ROS arguments.
    """
    # Errors that users can cause are reported in one line; others end with a traceback.
    reported = (
        ConfigError,
        BagError,
        InvalidQosOverridesError,
        NameValidationException,
        ParameterException,
    )
    stop = StopRequest()
    try:
        rclpy.init(args=list(argv), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # Whichever rcl raises, nothing can start.
        return fail(name, error)
    node = None
    try:
        node = make_node()
        # What a node has made at its start stays: collections during scans visit only what is new.
        gc.freeze()
        _spin(node, stop)
    except reported as error:
        return fail(name, error)
    except RuntimeError as error:
        # The error of rcl for an invalid node name has a private type.
        if not str(error).startswith("error creating node: "):
            raise
        return fail(name, RuntimeError(rcl_fault(error)))
    finally:
        _end(node, stop)
    return node.exit_status or OK


def _end(node: RunnableNode | None, stop: StopRequest) -> None:
    """Close a node, then destroy it and shut ROS down even if closing fails."""
    try:
        if node is not None:
            node.close()
    finally:
        try:
            if node is not None:
                node.destroy_node()
        finally:
            try_shutdown()
            stop.ignore_further()
            # The process ends here. Without this, its last garbage collection would visit every
            # object of the numerical libraries, which takes most of the time of a stop.
            gc.freeze()


def _spin(node: RunnableNode, stop: StopRequest) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not stop.made and node.exit_status is None:
            # The longest time until the spin loop notices a stop request.
            executor.spin_once(timeout_sec=0.1)
    except ExternalShutdownException:
        pass
    except Exception:
        # `close` reads this: the state of an interrupted step must not be stored in a checkpoint.
        node.exit_status = FAILED
        raise
    finally:
        executor.remove_node(node)
        executor.shutdown(timeout_sec=0.0)


def rcl_fault(error: Exception) -> str:
    """Return rcl's message about an argument, without the lines of its source."""
    # These are what rcl calls the arguments that it cannot parse, with their valid forms.
    forms = {
        "parameter override rule": "-p NAME:=VALUE",
        "remap rule": "-r FROM:=TO",
        "log level": "--log-level LEVEL or --log-level LOGGER:=LEVEL",
    }
    text = re.sub(r", at \S+:\d+", "", " ".join(str(error).split()))
    for kind, form in forms.items():
        found = re.search(f"Couldn't parse {kind}: '(.*)'", text)
        if found:
            hint = yaml_files.EMPTY_STRING if found[1].endswith(":=") else ""
            return f"{yaml_files.one_line(found[1])}: must be {form}{hint}"
    return yaml_files.one_line(text)
