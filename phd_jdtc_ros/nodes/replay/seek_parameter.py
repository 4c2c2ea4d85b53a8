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

    Parameters
    ----------
    fault : callable
        Returns why a given value is refused; empty if it is accepted.
    go_to : callable
        Called with an accepted value, in seconds.
    """

    def check(given: list[Parameter]) -> SetParametersResult:
        faults = [fault(parameter.value) for parameter in given if parameter.name == SEEK.name]
        reason = "; ".join(found for found in faults if found)
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
            dynamic_typing=True,  # so that a whole number is accepted too
        ),
        ignore_override=True,
    )
    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(follow)
