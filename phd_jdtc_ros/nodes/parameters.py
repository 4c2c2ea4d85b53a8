"""ROS parameters from the core's table: read what was given, check it whole, declare it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from phd_jdtc_ros.core.config import ConfigError
from phd_jdtc_ros.core.parameters import Parameter

# Parameters that rclpy declares for itself.
_OWN = ("use_sim_time", "start_type_description_service")


def given(node: Node) -> dict[str, Any]:
    """Return what the user set on the command line or in files, by dotted name.

    Taken from the arguments themselves, so that names which no table knows are seen too; rclpy
    would drop them.
    """
    return {
        # An empty list has no type, and arrives as None.
        name: [] if parameter.value is None else parameter.value
        for name, parameter in node.handle.get_parameters(rclpy.Parameter).items()
        if name not in _OWN and not name.startswith("qos_overrides.")
    }


def declare(node: Node, table: Mapping[str, Parameter], values: Mapping[str, Any]) -> None:
    """Declare checked values, described, ranged and read-only.

    A running tracker's structure cannot change; it is configured by a restart.
    """
    for name, parameter in table.items():
        node.declare_parameter(
            name, values[name], _descriptor(parameter, values[name]), ignore_override=True
        )


def resolve(node: Node, table: tuple[Parameter, ...], flags: Mapping[str, Any]) -> dict[str, Any]:
    """Check a node's parameters against a plain table, declare them, return their values.

    Parameters
    ----------
    node : Node
    table : tuple of Parameter
    flags : mapping of name to value
        From plain command-line flags; they win over ROS arguments.

    Raises
    ------
    ConfigError
        With every fault.
    """
    by_name = {parameter.name: parameter for parameter in table}
    found = {**given(node), **flags}
    faults = [f"{name}: unknown parameter" for name in found if name not in by_name]
    values = {}
    for name, parameter in by_name.items():
        value = found.get(name, parameter.default)
        values[name] = parameter.coerce(value)
        if values[name] is None:
            faults.append(f"{name}: {value!r} given, must be {parameter.allowed}")
    if faults:
        raise ConfigError(faults)
    declare(node, by_name, values)
    return values


def _descriptor(parameter: Parameter, value: Any) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=parameter.description,
        additional_constraints=f"must be {parameter.allowed}",
        read_only=True,
        # An empty list has no type of its own.
        dynamic_typing=value == [],
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
