"""ROS parameters by a table: read the given ones, check them together, declare them."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from phd_jdtc_ros.configuration.schema import ConfigError, Parameter, check
from phd_jdtc_ros.parameter_files import sections
from phd_jdtc_ros.parameter_files.sections import ParameterFile, is_own


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
    declare(node, {parameter.name: parameter for parameter in table}, values)
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
