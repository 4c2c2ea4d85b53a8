# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Publishers and subscriptions whose QoS users can override, and what becomes of it."""

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


def output_qos() -> QoSProfile:
    """Return what every output but the markers offers.

    New each time, for rclpy writes an override into the profile that it is given.
    """
    return QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def latched_qos() -> QoSProfile:
    """Return what the markers offer: a late joiner gets the last."""
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def _input_qos() -> QoSProfile:
    return QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def publisher(
    node: LifecycleNode, message_type: type, topic: str, qos: QoSProfile, health: OutputHealth
) -> Any:
    """Return a publisher that is silent while the node is not active.

    Raises
    ------
    ConfigError
        If the QoS given for it is none.
    """
    full = node.resolve_topic_name(topic)

    def on_incompatible(event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        health.refuse(full, event.total_count_change, time.monotonic())
        node.get_logger().warning(
            f"{full}: a subscription asks for incompatible QoS ({policy}), nothing comes to it"
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
    callback: Callable[..., None],
    health: InputHealth,
) -> Subscription:
    """Return a subscription to `health.topic` that counts what its QoS leads to in `health`.

    A deadline can be asked for beside the usual policies.

    Raises
    ------
    ConfigError
        If the QoS given for it is none.
    """

    def on_incompatible(event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        health.incompatible_qos += event.total_count_change
        node.get_logger().warning(
            f"{health.topic}: a publisher offers incompatible QoS ({policy}), nothing comes of it"
        )

    def on_deadline(event: Any) -> None:
        health.miss_deadline(event.total_count_change, time.monotonic())

    def possible(qos: QoSProfile) -> SetParametersResult:
        # The middleware would hang on another.
        return SetParametersResult(
            successful=qos.deadline.nanoseconds >= 0, reason="deadline: must be at least 0"
        )

    usual = QoSOverridingOptions.with_default_policies().policy_kinds
    with overridable.qos_of(health.topic):
        return node.create_subscription(
            message_type,
            health.topic,
            callback,
            _input_qos(),
            event_callbacks=SubscriptionEventCallbacks(
                deadline=on_deadline, incompatible_qos=on_incompatible
            ),
            qos_overriding_options=QoSOverridingOptions(
                [*usual, QoSPolicyKind.DEADLINE], callback=possible
            ),
        )


def publishers(node: LifecycleNode, listener: Subscription) -> Publishers:
    """Return who publishes what `listener` listens to, and who of them it cannot hear."""
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
