"""Seeking by a parameter, because std_srvs has no service that takes a number."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from phd_jdtc_ros.parameter_files.sensor_replay import SEEK


def declare(node: Node, fault: Callable[[Any], str], go_to: Callable[[float], None]) -> None:
    """Declare `seek_s`.

    `fault` returns the reason for which a value is refused, or an empty text; `go_to` receives an
    accepted value, seconds.
    """

    def check(given: list[Parameter]) -> SetParametersResult:
        faults = (fault(parameter.value) for parameter in given if parameter.name == SEEK.name)
        reason = "; ".join(filter(None, faults))
        return SetParametersResult(successful=not reason, reason=reason)

    def follow(given: list[Parameter]) -> None:
        for parameter in given:
            if parameter.name == SEEK.name:
                go_to(float(parameter.value))

    node.declare_parameter(
        SEEK.name,
        SEEK.default,
        ParameterDescriptor(
            description=SEEK.description,
            additional_constraints=f"must be {SEEK.allowed}",
            dynamic_typing=True,  # this accepts a whole number too
        ),
        ignore_override=True,
    )
    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(follow)
