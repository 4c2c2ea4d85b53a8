# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Running one node: start, spin, stop, and the exit status.

Signals only set a flag that the spin loop looks at, so a stop never interrupts a scan half-way,
a second signal changes nothing, and nothing is ever printed as a traceback because of one.
"""

from __future__ import annotations

import gc
import signal
from collections.abc import Callable, Sequence
from typing import Protocol

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.signals import SignalHandlerOptions

from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.core.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import FAILED, OK, fail

# The longest a stop request waits for the spin loop to look.
POLL_SECONDS = 0.1
# A warning that could be repeated without end is said once in this time.
WARNING_PERIOD_S = 5.0
# What users can cause; all else is a traceback.
REPORTED = (
    ConfigError,
    BagError,
    InvalidQosOverridesError,
    NameValidationException,
    ParameterException,
)


class RunnableNode(Protocol):
    """What `run` needs of a node beside its being one."""

    exit_status: int | None
    """None while the node has work; its exit status once it has ended by itself or failed."""

    def close(self) -> None:
        """Finish all output; called once, whatever ended the node.

        It may set the exit status if that fails.
        """
        ...


class StopRequest:
    """Set by SIGINT and SIGTERM from its making on."""

    def __init__(self) -> None:
        self.made = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._handle)

    def _handle(self, *_: object) -> None:
        self.made = True

    def ignore_further(self) -> None:
        """Ignore signals for good: the interpreter's own teardown would restore their defaults."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)


def run(name: str, make_node: Callable[[], Node], argv: Sequence[str]) -> int:
    """Run a node until it ends or is told to stop, and return the exit status.

    Parameters
    ----------
    name : str
        Of the executable, for messages.
    make_node : callable
        Makes the node, a `RunnableNode`, once ROS is up.
    argv : sequence of str
        Arguments with the ROS ones.
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
    finally:
        _end(node, stop)
    return node.exit_status or OK


def _end(node: Node | None, stop: StopRequest) -> None:
    """Close a node, and take it and ROS down even if that fails."""
    try:
        if node is not None:
            node.close()
    finally:
        try:
            if node is not None:
                node.destroy_node()
        finally:
            rclpy.try_shutdown()
            stop.ignore_further()
            # The process ends here. Its last collection would look at every object of the numerical
            # libraries, which takes most of the time of a stop.
            gc.freeze()


def _spin(node: Node, stop: StopRequest) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not stop.made and node.exit_status is None:
            executor.spin_once(timeout_sec=POLL_SECONDS)
    except ExternalShutdownException:
        pass
    except Exception:
        # What was left half-way must not be stored as if it were whole: `close` looks at this.
        node.exit_status = FAILED
        raise
    finally:
        executor.remove_node(node)
        executor.shutdown(timeout_sec=0.0)
