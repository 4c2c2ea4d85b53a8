"""The radars' side of the live measurement: sends scans and receives the tracker's output."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters.encoding import names, stamps
from msg_adapters.incoming import detections
from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.configuration.parameters.radar import RadarParameters
from phd_jdtc_ros.core.types import Scan
from robustness.harness.radars import SETTLE_S, Peer


@dataclass
class Reply:
    """The tracker's reply to a scan so far; times are monotonic seconds."""

    # Time at which the filtered estimates were received; nan before.
    estimate_s: float = float("nan")
    last_s: float = float("nan")  # Time at which the scan's latest message was received
    step_ms: float = float("nan")  # CPU time of the step as reported by the tracker; nan before
    # Expected number of targets as reported by the tracker; nan before.
    targets: float = float("nan")

    @property
    def whole(self) -> bool:
        """Whether both messages have been received."""
        return not (math.isnan(self.estimate_s) or math.isnan(self.step_ms))


class Radars(Peer):
    """Publishes the clouds of each radar to the tracker and records when its replies come."""

    def __init__(self, inputs: Sequence[RadarParameters]) -> None:
        super().__init__("benchmark_radars")
        self._inputs = tuple(inputs)
        self._outputs = [
            self.node.create_publisher(PointCloud2, radar.topic, 50) for radar in self._inputs
        ]
        self.replies: dict[int, Reply] = {}
        self.node.create_subscription(
            PointCloud2, names.estimates("filtered"), self._on_estimate, 50
        )
        self.node.create_subscription(DiagnosticArray, names.cardinality(), self._on_figures, 50)
        self._client = self.node.create_client(Trigger, f"{names.TRACKER}/reset")

    def connected(self, timeout_s: float) -> bool:
        """Wait until both directions to the tracker are connected; return whether they are."""

        def linked() -> bool:
            sending = all(output.get_subscription_count() for output in self._outputs)
            topics = (names.estimates("filtered"), names.cardinality())
            receiving = all(self.node.count_publishers(topic) for topic in topics)
            return sending and receiving and self._client.service_is_ready()

        found = self.spin_until(linked, timeout_s)
        self.spin(SETTLE_S)
        return found

    def reset(self) -> None:
        """Reset the tracker, and forget its replies."""
        future = self._client.call_async(Trigger.Request())
        self.spin_until(future.done, SETTLE_S * 10)
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
        """Wait for the result of `reply_to`; return None after the timeout."""
        self.spin_until(lambda: self.reply_to(stamp_ns, length_ns) is not None, timeout_s)
        return self.reply_to(stamp_ns, length_ns)

    def reply_to(self, stamp_ns: int, length_ns: int = 1) -> Reply | None:
        """Return the last complete reply to a report, None if there is none.

        The report covers the time `length_ns` until its stamp: the tracker gives the scan of a
        sector a stamp within it.
        """
        whole = {stamp: reply for stamp, reply in self.replies.items() if reply.whole}
        last = max((s for s in whole if stamp_ns - length_ns < s <= stamp_ns), default=None)
        return None if last is None else whole[last]

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
