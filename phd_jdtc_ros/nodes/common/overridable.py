# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""QoS that users can override with parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription

from phd_jdtc_ros.core.configuration.schema import ConfigError


@contextmanager
def qos_of(topic: str) -> Iterator[None]:
    """Name the parameter if the QoS of an endpoint that is made in this block is not valid.

    Parameters
    ----------
    topic : str
        Its full name.

    Raises
    ------
    ConfigError
        If the QoS override is not valid.
    """
    try:
        yield
    # rclpy raises these for an unknown policy, for a value of a wrong type, and for a refusal.
    except (RuntimeError, ParameterException, ValueError, InvalidQosOverridesError) as error:
        raise ConfigError([f"qos_overrides.{topic}: {error}"]) from error


def subscribe(
    node: Node, message_type: type, topic: str, callback: Callable[..., None], depth: int
) -> Subscription:
    """Subscribe reliably, unless ``qos_overrides.TOPIC.subscription`` says otherwise.

    Raises
    ------
    ConfigError
        If the QoS override is not valid.
    """
    # New each time, because rclpy writes an override into the profile that it is given.
    qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)
    options = QoSOverridingOptions.with_default_policies()
    with qos_of(node.resolve_topic_name(topic)):
        return node.create_subscription(
            message_type, topic, callback, qos, qos_overriding_options=options
        )
