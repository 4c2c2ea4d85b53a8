"""The tracker's publishers and subscriptions: users can override their QoS, faults are counted."""

from __future__ import annotations

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

from ..common import topics
from .health import InputHealth, OutputHealth, Publishers

# Least depth of an input, whose messages wait while a scan is stepped.
INPUT_DEPTH = 50


def publisher(
    node: LifecycleNode,
    message_type: type,
    topic: str,
    qos: QoSProfile,
    health: OutputHealth,
    on_subscriber: Callable[[], None] | None = None,
) -> Any:
    """Return a publisher that is silent while the node is not active.

    `on_subscriber` is called when a subscription is matched.
    """
    full = node.resolve_topic_name(topic)

    def on_incompatible(event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        health.refused[full] += event.total_count_change
        node.get_logger().warning(
            f"{full}: a subscription asks for incompatible QoS ({policy}), it receives nothing"
        )

    def on_matched(event: Any) -> None:
        if on_subscriber is not None and event.current_count_change > 0:
            on_subscriber()

    with topics.qos_of(full):
        return node.create_lifecycle_publisher(
            message_type,
            topic,
            qos,
            event_callbacks=PublisherEventCallbacks(
                incompatible_qos=on_incompatible,
                matched=None if on_subscriber is None else on_matched,
                # Each event costs time, because an executor checks all of them whenever it waits.
                use_default_callbacks=False,
            ),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )


class Listener:
    """A subscription that is reliable as long as its publishers are, whose events are counted.

    By default it requests the best available reliability. The middleware decides once, by the
    present publishers: it is reliable, unless one of them offers best effort only. So the listener
    subscribes again when such a publisher appears, and when all publishers are reliable again.

    In addition to the usual policies, the deadline can be overridden. The callback receives each
    message, or with `raw` its bytes, and its information. A `latched` one also receives the last
    messages from before.
    """

    def __init__(
        self,
        node: LifecycleNode,
        message_type: type,
        topic: str,
        callback: Callable[..., None],
        health: InputHealth,
        depth: int = INPUT_DEPTH,
        *,
        raw: bool = False,
        latched: bool = False,
    ) -> None:
        self._node, self._health = node, health
        self._asked = message_type, topic, callback
        self._depth, self._raw = depth, raw
        self._durability = (
            DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        )
        self.subscription = self._subscribe()

    def _subscribe(self) -> Subscription:
        usual = QoSOverridingOptions.with_default_policies().policy_kinds
        # A new profile is made each time, because rclpy writes overrides into the given one.
        qos = QoSProfile(
            depth=self._depth,
            reliability=ReliabilityPolicy.BEST_AVAILABLE,
            durability=self._durability,
        )
        with topics.qos_of(self._health.topic):
            return self._node.create_subscription(
                *self._asked,
                qos,
                event_callbacks=SubscriptionEventCallbacks(
                    deadline=self._on_deadline, incompatible_qos=self._on_incompatible
                ),
                qos_overriding_options=QoSOverridingOptions(
                    [*usual, QoSPolicyKind.DEADLINE], callback=_check_deadline
                ),
                raw=self._raw,
            )

    def _renew(self) -> None:
        self.destroy()
        self.subscription = self._subscribe()

    @property
    def _adapts(self) -> bool:
        """Whether no QoS override sets its reliability."""
        adapts: bool = self.subscription.qos_profile.reliability == ReliabilityPolicy.BEST_AVAILABLE
        return adapts

    def _on_incompatible(self, event: Any) -> None:
        if self._adapts and event.last_policy_kind == QoSPolicyKind.RELIABILITY:
            self._node.get_logger().info(f"{self._health.topic}: offered and received best effort")
            self._renew()
            return
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        self._health.incompatible_qos += event.total_count_change
        self._node.get_logger().warning(
            f"{self._health.topic}: a publisher offers incompatible QoS ({policy}), "
            "nothing is received from it"
        )

    def _on_deadline(self, event: Any) -> None:
        self._health.deadlines_missed += event.total_count_change

    def publishers(self) -> Publishers:
        """Return the publishers on the topic, with those whose QoS is incompatible."""
        listener = self.subscription
        found = self._node.get_publishers_info_by_topic(listener.topic_name)
        verdicts = [qos_check_compatible(info.qos_profile, listener.qos_profile) for info in found]
        return Publishers(
            frozenset(tuple(info.endpoint_gid) for info in found),
            tuple(
                reason.removeprefix("ERROR: ").rstrip("; ")
                for fits, reason in verdicts
                if fits == QoSCompatibility.ERROR
            ),
            topics.publisher_hint(self._node, listener.topic_name, self._asked[0]),
        )

    def improve(self) -> None:
        """Subscribe reliably again if all publishers now offer it."""
        topic, name = self.subscription.topic_name, self._node.get_name()
        if not self._adapts:
            return
        own = [
            info.qos_profile.reliability
            for info in self._node.get_subscriptions_info_by_topic(topic)
            if (info.node_namespace, info.node_name) == (self._node.get_namespace(), name)
        ]
        if ReliabilityPolicy.BEST_EFFORT not in own:
            return
        offered = {
            info.qos_profile.reliability for info in self._node.get_publishers_info_by_topic(topic)
        }
        if offered == {ReliabilityPolicy.RELIABLE}:
            self._node.get_logger().info(f"{self._health.topic}: offered and received reliably")
            self._renew()

    def destroy(self) -> None:
        """Destroy the subscription."""
        self._node.destroy_subscription(self.subscription)


def _check_deadline(qos: QoSProfile) -> SetParametersResult:
    # The middleware would hang on a negative deadline.
    return SetParametersResult(
        successful=qos.deadline.nanoseconds >= 0, reason="deadline: must be at least 0"
    )
