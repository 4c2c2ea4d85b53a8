"""A node's arguments and ROS parameters, and those of a live tracker on request.

Parameters follow a table: the given ones are read, checked together, and declared.
"""

from __future__ import annotations

import math
import sys
import time
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from phd_jdtc_ros.configuration.schema import ConfigError, Parameter, check
from phd_jdtc_ros.exit_status import ArgumentParser, fail
from phd_jdtc_ros.parameter_files import sections
from phd_jdtc_ros.parameter_files.sections import ParameterFile, is_own

from .runtime import rcl_fault, steady_timer


def given_files(name: str, purpose: str, argv: Sequence[str]) -> tuple[ParameterFile, ...]:
    """Show the help if requested, and return the parameter files among the ROS arguments.

    Arguments that are not ROS arguments are refused, because rclpy ignores them silently: a
    parameter file without ``--ros-args`` before it has no effect. Raise `SystemExit` with status 0
    after the help, and with 2 after a refusal.
    """
    examples = "--ros-args -p NAME:=VALUE, --params-file FILE, -r FROM:=TO, -r __ns:=/NAME"
    parser = ArgumentParser(
        name,
        usage="%(prog)s [-h] [--ros-args ...]",
        # The rest of a node's docstring is for readers of its code.
        description=purpose.partition("\n\n")[0],
        epilog=f"ROS arguments are, for instance: {examples}",
    )
    others, files = split(name, argv)
    parser.parse_args(others)
    return files


def split(name: str, argv: Sequence[str]) -> tuple[list[str], tuple[ParameterFile, ...]]:
    """Return the other arguments, and the parameter files of the ROS arguments.

    Raise `SystemExit` with status 2 after a line for each fault of the ROS arguments.
    """
    # ROS arguments that are refused with advice where they are given as others.
    of_ros = ("-p", "--param", "--params-file", "-r", "--remap", "--log-level", "-e", "--enclave")
    try:
        # Files are checked first, because rcl does not name the fault of a file.
        files = sections.given_in(argv)
        others = remove_ros_args([name, *argv])[1:]
        misplaced = [word for word in others if word in of_ros]
        if misplaced:
            raise ConfigError(f"{misplaced[0]}: is a ROS argument, must follow --ros-args")
        return others, files
    except ConfigError as error:
        raise SystemExit(fail(name, error)) from error
    except Exception as error:  # Its own type is private to rclpy.
        raise SystemExit(fail(name, ConfigError(rcl_fault(error)))) from error


def given_values(node: Node, files: Sequence[ParameterFile]) -> dict[str, Any]:
    """Return the parameters that the user set on the command line or in files, by dotted name.

    They are read from the arguments themselves, so that unknown names are included; rclpy would
    drop them. A file that is only for other nodes is logged.

    Raise `ConfigError` with all files if none of the user's is for the node.
    """
    name = node.get_fully_qualified_name()
    found = [file.sections_for(name) for file in files]
    for line in sections.require_one(name, files, found):
        node.get_logger().info(f"{line}; it is not used")
    return {
        # An empty list has no type, and arrives as None.
        name: [] if parameter.value is None else parameter.value
        for name, parameter in node.handle.get_parameters(RosParameter).items()
        if is_own(name)
    }


def sources(node: Node, files: Sequence[ParameterFile]) -> list[Path]:
    """Return the user's files that set parameters of the node."""
    name = node.get_fully_qualified_name()
    of_user = (file for file in files if not file.is_of_launch)
    return [file.path for file in of_user if sections.own_values(file.sections_for(name))]


def declare(
    node: Node,
    table: Mapping[str, Parameter],
    values: Mapping[str, Any],
    mutable: frozenset[str] = frozenset(),
) -> None:
    """Declare checked values with descriptions and ranges, read-only unless in `mutable`.

    The node may refuse some mutable ones while it is configured, as their descriptions state.
    """
    for name, parameter in table.items():
        descriptor = _descriptor(parameter, values[name])
        descriptor.read_only = name not in mutable
        if not (parameter.mutable or descriptor.read_only):
            descriptor.additional_constraints += "; changes while the node is not configured"
        node.declare_parameter(name, values[name], descriptor, ignore_override=True)


def redeclare(
    node: Node, table: Mapping[str, Parameter], values: Mapping[str, Any], changed: Iterable[str]
) -> None:
    """Replace a node's parameters, which may all change, by a table; `changed` have new values."""
    own = {name for name in node.get_parameters_by_prefix("") if is_own(name)}
    # The parameter is declared again and not set, because an empty list has another type than one
    # of numbers.
    for name in own.difference(table).union(own.intersection(changed)):
        node.undeclare_parameter(name)
    new = {name: entry for name, entry in table.items() if not node.has_parameter(name)}
    declare(node, new, values, frozenset(new))


def same(given: Any, value: Any) -> bool:
    """Return whether a value from a message equals a parameter's; whole numbers may be real."""
    if isinstance(value, list):
        # An empty list has no type, and arrives as None.
        found = [] if given is None else given
        if not isinstance(found, (list, tuple, array)):
            return False
        return len(found) == len(value) and all(map(same, found, value))
    return isinstance(given, bool) == isinstance(value, bool) and bool(given == value)


def resolve(
    node: Node,
    table: tuple[Parameter, ...],
    flags: Mapping[str, Any],
    files: Sequence[ParameterFile],
    old: Mapping[str, str],
) -> dict[str, Any]:
    """Check a node's parameters against a plain table, declare them, return their values.

    `flags` are from plain command-line flags and override ROS arguments. `old` has hints by former
    names. All faults are raised as one `ConfigError`.
    """
    values, faults = check(table, {**given_values(node, files), **flags}, old)
    if faults:
        raise ConfigError(*faults)
    mutable = frozenset(parameter.name for parameter in table if parameter.mutable)
    declare(node, {parameter.name: parameter for parameter in table}, values, mutable)
    return values


def _descriptor(parameter: Parameter, value: Any) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=parameter.description,
        additional_constraints=f"must be {parameter.allowed}",
        # An empty list, which a list may become, has no type of its own, and some values are
        # written in several ways.
        dynamic_typing=value == []
        or (parameter.mutable and isinstance(value, list))
        or parameter.form is not None,
    )
    largest = sys.float_info.max
    low, high = max(parameter.low, -largest), min(parameter.high, largest)
    if isinstance(value, float) and (low, high) != (-largest, largest):
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif isinstance(value, int) and not isinstance(value, bool):
        descriptor.integer_range = [
            IntegerRange(from_value=int(parameter.low), to_value=int(parameter.high))
        ]
    return descriptor


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
