"""Asks a live tracker for its parameters, for nodes that compare or record them."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

# How often it is looked for.
PERIOD_S = 0.1


class TrackerParameters:
    """Asks a tracker for its parameters once, when it is there.

    Parameters
    ----------
    tracker : str
        The tracker's full name.
    answered : callable
        Gets all values by dotted name. It is never called if the tracker does not answer.
    """

    def __init__(
        self, node: Node, tracker: str, answered: Callable[[dict[str, Any]], None]
    ) -> None:
        self._list = node.create_client(ListParameters, f"{tracker}/list_parameters")
        self._get = node.create_client(GetParameters, f"{tracker}/get_parameters")
        self._answered = answered
        # By the wall clock, because simulated time may stand still.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(PERIOD_S, self._look, clock=steady)

    def _look(self) -> None:
        if self._list.service_is_ready() and self._get.service_is_ready():
            self._timer.cancel()
            self._list.call_async(ListParameters.Request()).add_done_callback(self._on_names)

    def _on_names(self, future: Future) -> None:
        names = list(future.result().result.names)
        request = GetParameters.Request(names=names)
        self._get.call_async(request).add_done_callback(
            lambda answer: self._on_values(names, answer)
        )

    def _on_values(self, names: list[str], future: Future) -> None:
        values = future.result().values
        # A parameter that has gone since it was listed leaves the answer empty.
        if len(values) == len(names):
            self._answered({name: _plain(value) for name, value in zip(names, values, strict=True)})


def _plain(value: ParameterValue) -> Any:
    found = parameter_value_to_python(value)
    # An empty list has no type, and arrives as None.
    if found is None:
        return []
    return list(found) if isinstance(found, (array, tuple)) else found
