# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""QoS that users can override by parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions

from phd_jdtc_ros.core.config import ConfigError


@contextmanager
def qos_of(topic: str) -> Iterator[None]:
    """Say by parameter what is wrong with the QoS of an endpoint that is made in this block.

    Parameters
    ----------
    topic : str
        Its full name.

    Raises
    ------
    ConfigError
        If the QoS given for it is none.
    """
    try:
        yield
    # What rclpy raises for a policy it does not know, for one of another type, and for a refusal.
    except (RuntimeError, ParameterException, ValueError, InvalidQosOverridesError) as error:
        raise ConfigError([f"qos_overrides.{topic}: {error}"]) from error


def subscribe(
    node: Node, message_type: type, topic: str, callback: Callable[..., None], depth: int
) -> None:
    """Subscribe reliably, unless ``qos_overrides.TOPIC.subscription`` says otherwise.

    Raises
    ------
    ConfigError
        If the QoS given for it is none.
    """
    # New each time, for rclpy writes an override into the profile that it is given.
    qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)
    options = QoSOverridingOptions.with_default_policies()
    with qos_of(node.resolve_topic_name(topic)):
        node.create_subscription(message_type, topic, callback, qos, qos_overriding_options=options)
