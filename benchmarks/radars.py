"""The radars' side of the live measurement: sends scans and receives the tracker's output."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters import detections, diagnostics, names, stamps
from phd_jdtc_ros.configuration.radar_input import RadarInput
from phd_jdtc_ros.core.types import Scan

# That one side has discovered the other does not mean that the other has too.
SETTLE_S = 0.5


@dataclass
class Reply:
    """The tracker's reply to a scan so far; times are monotonic seconds.

    Parameters
    ----------
    estimate_s : float
        Time at which the filtered estimates were received; nan before.
    last_s : float
        Time at which the scan's latest message was received.
    step_ms : float
        CPU time of the step as reported by the tracker; nan before.
    targets : float
        Expected number of targets as reported by the tracker; nan before.
    """

    estimate_s: float = float("nan")
    last_s: float = float("nan")
    step_ms: float = float("nan")
    targets: float = float("nan")

    @property
    def whole(self) -> bool:
        """Whether both messages have been received."""
        return not (math.isnan(self.estimate_s) or math.isnan(self.step_ms))


class Radars:
    """Publishes clouds to the tracker and records when its replies come.

    Parameters
    ----------
    inputs : sequence of RadarInput
        Topics and layouts of the clouds, one per radar.
    """

    def __init__(self, inputs: Sequence[RadarInput]) -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("benchmark_radars", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._inputs = tuple(inputs)
        self._outputs = [
            self._node.create_publisher(PointCloud2, radar.topic, 50) for radar in self._inputs
        ]
        self.replies: dict[int, Reply] = {}
        self._node.create_subscription(
            PointCloud2, names.estimates("filtered"), self._on_estimate, 50
        )
        self._node.create_subscription(DiagnosticArray, names.cardinality(), self._on_figures, 50)
        self._client = self._node.create_client(Trigger, f"{names.TRACKER}/reset")

    def close(self) -> None:
        """End the node."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def connected(self, timeout_s: float) -> bool:
        """Wait until both directions to the tracker are connected; return whether they are."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            sending = all(output.get_subscription_count() for output in self._outputs)
            topics = (names.estimates("filtered"), names.cardinality())
            receiving = all(self._node.count_publishers(topic) for topic in topics)
            if sending and receiving and self._client.service_is_ready():
                self.spin(SETTLE_S)
                return True
            self.spin(0.05)
        return False

    def reset(self) -> None:
        """Reset the tracker, and forget its replies."""
        future = self._client.call_async(Trigger.Request())
        self._executor.spin_until_future_complete(future, timeout_sec=SETTLE_S * 10)
        self.replies.clear()

    def send(self, scan: Scan) -> float:
        """Publish a scan's clouds; return the time just before the last was published."""
        clouds = [
            detections.to_msg(report, scan.stamp_ns, radar.frame, radar)
            for report, radar in zip(scan.detections, self._inputs, strict=True)
            if report is not None
        ]
        for cloud, output in zip(clouds, self._outputs, strict=True):
            sent = time.monotonic()
            output.publish(cloud)
        return sent

    def wait_for(self, stamp_ns: int, timeout_s: float, length_ns: int = 1) -> Reply | None:
        """Return what `reply_to` returns once it is there, or None after the timeout."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            reply = self.reply_to(stamp_ns, length_ns)
            if reply is not None:
                return reply
            self._executor.spin_once(timeout_sec=0.05)
        return None

    def reply_to(self, stamp_ns: int, length_ns: int = 1) -> Reply | None:
        """Return the last complete reply to a report, None if there is none.

        Parameters
        ----------
        length_ns : int
            Time that the report covers until its stamp: the tracker gives the scan of a sector a
            stamp within it.
        """
        whole = {stamp: reply for stamp, reply in self.replies.items() if reply.whole}
        last = max((s for s in whole if stamp_ns - length_ns < s <= stamp_ns), default=None)
        return None if last is None else whole[last]

    def spin(self, seconds: float) -> None:
        """Receive messages for a time."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def _on_estimate(self, cloud: PointCloud2) -> None:
        reply = self._reply(stamps.to_ns(cloud.header.stamp))
        reply.estimate_s = reply.last_s = time.monotonic()

    def _on_figures(self, array: DiagnosticArray) -> None:
        reply = self._reply(stamps.to_ns(array.header.stamp))
        reply.last_s = time.monotonic()
        values = diagnostics.values_of(array.status[0])
        reply.step_ms, reply.targets = float(values["step_ms"]), float(values["total"])

    def _reply(self, stamp_ns: int) -> Reply:
        return self.replies.setdefault(stamp_ns, Reply())
