"""Running one node: start, spin, stop, and the exit status.

Signals only set a flag that the spin loop reads. So a stop never interrupts a scan, a second signal
has no effect, and a signal never causes a traceback.
"""

from __future__ import annotations

import gc
import signal
from collections.abc import Callable, Sequence

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import FAILED, OK, fail

from .arguments import rcl_fault

# The longest time until the spin loop notices a stop request.
POLL_SECONDS = 0.1
# Errors that users can cause are reported in one line; others end with a traceback.
REPORTED = (
    ConfigError,
    BagError,
    InvalidQosOverridesError,
    NameValidationException,
    ParameterException,
)


class RunnableNode(Node):
    """A node that `run` runs until its exit status, None at first, is set."""

    exit_status: int | None = None

    def close(self) -> None:
        """Finish all output, once, however the node ended; may set the exit status."""


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
    stop = StopRequest()
    try:
        rclpy.init(args=list(argv), signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rcl raises several kinds; all mean that nothing can start
        return fail(name, error)
    node = None
    try:
        node = make_node()
        _spin(node, stop)
    except REPORTED as error:
        return fail(name, error)
    except RuntimeError as error:
        # rcl's error for an invalid node name has a private type.
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
            executor.spin_once(timeout_sec=POLL_SECONDS)
    except ExternalShutdownException:
        pass
    except Exception:
        # `close` reads this: the state of an interrupted step must not be stored in a checkpoint.
        node.exit_status = FAILED
        raise
    finally:
        executor.remove_node(node)
        executor.shutdown(timeout_sec=0.0)
