"""Requests the parameters of a live tracker, for nodes that compare or record them."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from .callbacks import steady_timer

# Interval between searches for the tracker's services, seconds.
PERIOD_S = 0.1


class TrackerParameters:
    """Requests a tracker's parameters once, as soon as its services are there.

    `on_values` receives all values by dotted name. Without a reply it is never called.
    """

    def __init__(
        self, node: Node, tracker: str, on_values: Callable[[dict[str, Any]], None]
    ) -> None:
        self._list = node.create_client(ListParameters, f"{tracker}/list_parameters")
        self._get = node.create_client(GetParameters, f"{tracker}/get_parameters")
        self._on_all = on_values
        self._timer = steady_timer(node, PERIOD_S, self._look)

    def _look(self) -> None:
        if self._list.service_is_ready() and self._get.service_is_ready():
            self._timer.cancel()
            self._list.call_async(ListParameters.Request()).add_done_callback(self._on_names)

    def _on_names(self, future: Future) -> None:
        names = list(future.result().result.names)
        request = GetParameters.Request(names=names)
        self._get.call_async(request).add_done_callback(lambda reply: self._on_values(names, reply))

    def _on_values(self, names: list[str], future: Future) -> None:
        values = future.result().values
        # The reply is empty if a parameter was removed after it was listed.
        if len(values) == len(names):
            self._on_all({name: _plain(value) for name, value in zip(names, values, strict=True)})


def _plain(value: ParameterValue) -> Any:
    found = parameter_value_to_python(value)
    # An empty list has no type, and arrives as None.
    if found is None:
        return []
    return list(found) if isinstance(found, (array, tuple)) else found
