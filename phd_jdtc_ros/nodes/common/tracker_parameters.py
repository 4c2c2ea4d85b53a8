"""Requests the parameters of a live tracker, for nodes that compare or record them."""

from __future__ import annotations

import math
import time
from array import array
from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from .callbacks import steady_timer

# Interval between searches for the tracker's services, and time after which a request is repeated,
# seconds. The tracker drops a reply if it has not discovered this client's reader yet.
PERIOD_S, PATIENCE_S = 0.1, 2.0


class TrackerParameters:
    """Requests a tracker's parameters as soon as its services are there, until it has replied.

    `on_values` receives all values by dotted name, once. Without a reply it is never called.
    """

    def __init__(
        self, node: Node, tracker: str, on_values: Callable[[dict[str, Any]], None]
    ) -> None:
        self._list = node.create_client(ListParameters, f"{tracker}/list_parameters")
        self._get = node.create_client(GetParameters, f"{tracker}/get_parameters")
        self._on_all = on_values
        self._requested_at = -math.inf
        self._pending: tuple[Client, Future] | None = None
        self._timer = steady_timer(node, PERIOD_S, self._look)

    def _look(self) -> None:
        """Request the names once the services are there, again if there was no reply."""
        if time.monotonic() < self._requested_at + PATIENCE_S:
            return
        if self._list.service_is_ready() and self._get.service_is_ready():
            self._requested_at = time.monotonic()
            self._request(self._list, ListParameters.Request(), self._on_names)

    def _request(self, client: Client, request: Any, on_reply: Callable[[Any], None]) -> None:
        """Send a request instead of the previous one, whose reply is no longer awaited."""
        if self._pending is not None:
            before, future = self._pending
            before.remove_pending_request(future)
        future = client.call_async(request)
        self._pending = client, future
        future.add_done_callback(lambda reply: on_reply(reply.result()))

    def _on_names(self, reply: ListParameters.Response) -> None:
        names = list(reply.result.names)
        self._request(
            self._get, GetParameters.Request(names=names), partial(self._on_values, names)
        )

    def _on_values(self, names: list[str], reply: GetParameters.Response) -> None:
        # The reply is empty if a parameter was removed after it was listed; they are listed again.
        if len(reply.values) != len(names):
            return
        self._timer.cancel()
        self._on_all({name: _plain(v) for name, v in zip(names, reply.values, strict=True)})


def _plain(value: ParameterValue) -> Any:
    found = parameter_value_to_python(value)
    # An empty list has no type, and arrives as None.
    if found is None:
        return []
    return list(found) if isinstance(found, (array, tuple)) else found
