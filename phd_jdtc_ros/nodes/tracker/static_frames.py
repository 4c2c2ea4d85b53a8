"""The publisher of the radars' frames, so that viewers and recordings can place their clouds."""

from __future__ import annotations

from typing import Any

from rclpy.lifecycle import LifecycleNode

from msg_adapters import frames, names
from msg_adapters.frames import Mounting
from phd_jdtc_ros.configuration.tracker_node import Settings

from . import endpoints


class StaticFrames:
    """Publishes the radars' poses once; whoever joins later gets them too."""

    def __init__(self, node: LifecycleNode, settings: Settings) -> None:
        self._node = node
        self._publisher = self._publish(settings) if "frames" in settings.node["outputs"] else None

    def _publish(self, settings: Settings) -> Any:
        """Return the publisher; None if the type of the transforms is not installed."""
        kind = frames.message_class()
        if kind is None:
            self._node.get_logger().info(
                "tf2_msgs is not installed: the radars' frames are not published on "
                f"{names.STATIC_FRAMES}; ~/detections needs none of them",
                once=True,
            )
            return None
        config = settings.config
        mountings = [
            Mounting(source.frame, model.position, model.yaw)
            for source, model in zip(config.inputs, config.model.radars, strict=True)
            # Whoever moves a radar publishes its frame.
            if not source.pose_topic
        ]
        publisher = self._node.create_publisher(kind, names.STATIC_FRAMES, endpoints.latched_qos())
        stamp_ns = self._node.get_clock().now().nanoseconds
        publisher.publish(frames.to_cdr(mountings, stamp_ns, config.world_frame))
        return publisher

    def destroy(self) -> None:
        """Destroy the publisher."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None
