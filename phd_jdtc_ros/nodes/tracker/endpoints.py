# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Publishers and subscriptions whose QoS users can override, with incompatibilities counted."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
    qos_policy_name_from_kind,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from ..common import overridable
from .health import InputHealth, OutputHealth, Publishers

# Scans of a radar that wait while one is stepped.
INPUT_DEPTH = 10


def output_qos() -> QoSProfile:
    """Return the QoS of every output but the markers.

    New each time, because rclpy writes an override into the profile that it is given.
    """
    return QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def latched_qos() -> QoSProfile:
    """Return the QoS of the markers: a late subscriber receives the last message."""
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def _input_qos(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def publisher(
    node: LifecycleNode, message_type: type, topic: str, qos: QoSProfile, health: OutputHealth
) -> Any:
    """Return a publisher that is silent while the node is not active.

    Raises
    ------
    ConfigError
        If the QoS override is not valid.
    """
    full = node.resolve_topic_name(topic)

    def on_incompatible(event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        health.refuse(full, event.total_count_change, time.monotonic())
        node.get_logger().warning(
            f"{full}: a subscription asks for incompatible QoS ({policy}), it receives nothing"
        )

    with overridable.qos_of(full):
        return node.create_lifecycle_publisher(
            message_type,
            topic,
            qos,
            event_callbacks=PublisherEventCallbacks(incompatible_qos=on_incompatible),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )


def subscription(
    node: LifecycleNode,
    message_type: type,
    topic: str,
    callback: Callable[..., None],
    health: InputHealth,
    depth: int = INPUT_DEPTH,
) -> Subscription:
    """Return a subscription to `topic` whose QoS events are counted in `health`.

    `depth` is its history's. In addition to the usual policies, the deadline can be overridden.

    Raises
    ------
    ConfigError
        If the QoS override is not valid.
    """

    def on_incompatible(event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        health.incompatible_qos += event.total_count_change
        node.get_logger().warning(
            f"{health.topic}: a publisher offers incompatible QoS ({policy}), "
            "nothing is received from it"
        )

    def on_deadline(event: Any) -> None:
        health.miss_deadline(event.total_count_change, time.monotonic())

    def possible(qos: QoSProfile) -> SetParametersResult:
        # The middleware would hang on a negative deadline.
        return SetParametersResult(
            successful=qos.deadline.nanoseconds >= 0, reason="deadline: must be at least 0"
        )

    usual = QoSOverridingOptions.with_default_policies().policy_kinds
    with overridable.qos_of(health.topic):
        return node.create_subscription(
            message_type,
            topic,
            callback,
            _input_qos(depth),
            event_callbacks=SubscriptionEventCallbacks(
                deadline=on_deadline, incompatible_qos=on_incompatible
            ),
            qos_overriding_options=QoSOverridingOptions(
                [*usual, QoSPolicyKind.DEADLINE], callback=possible
            ),
        )


def publishers(node: LifecycleNode, listener: Subscription) -> Publishers:
    """Return the publishers on the topic of `listener`, with those whose QoS is incompatible."""
    found = node.get_publishers_info_by_topic(listener.topic_name)
    verdicts = [qos_check_compatible(info.qos_profile, listener.qos_profile) for info in found]
    return Publishers(
        frozenset(tuple(info.endpoint_gid) for info in found),
        tuple(
            reason.removeprefix("ERROR: ").rstrip("; ")
            for fits, reason in verdicts
            if fits == QoSCompatibility.ERROR
        ),
    )
