"""Topics that parameters name, with QoS that users can override with parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription

from phd_jdtc_ros.configuration.schema import ConfigError


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


def full_name(node: Node, topic: str, parameter: str, given: str | None = None) -> str:
    """Return the name of a topic after remapping.

    Parameters
    ----------
    parameter : str
        Which parameter the topic comes from, for the error.
    given : str or None
        The parameter's value; None if that is the topic.

    Raises
    ------
    ConfigError
        If there cannot be a topic of this name.
    """
    try:
        name: str = node.resolve_topic_name(topic)
    except RuntimeError as error:  # rcl's own, whose type is private
        what = "topic" if given is None else "node"
        value = topic if given is None else given
        raise ConfigError([f"{parameter}: {value!r} given, must be a {what}'s name"]) from error
    return name


def subscribe(
    node: Node,
    message_type: type,
    topic: str,
    callback: Callable[..., None],
    depth: int,
    parameter: str,
    given: str | None = None,
) -> Subscription:
    """Subscribe reliably, unless ``qos_overrides.TOPIC.subscription`` says otherwise.

    `parameter` and `given` are those of `full_name`.

    Raises
    ------
    ConfigError
        If there cannot be a topic of this name, or the QoS override is not valid.
    """
    # New each time, because rclpy writes an override into the profile that it is given.
    qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)
    options = QoSOverridingOptions.with_default_policies()
    with qos_of(full_name(node, topic, parameter, given)):
        return node.create_subscription(
            message_type, topic, callback, qos, qos_overriding_options=options
        )
