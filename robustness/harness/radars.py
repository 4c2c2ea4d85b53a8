"""The radars' side: sends scans to a live tracker and receives its output."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from msg_adapters.encoding import RejectedMessageError, names, stamps
from msg_adapters.outgoing import diagnostics
from msg_adapters.targets import estimates
from phd_jdtc_ros.core.arrays import FloatArray
from phd_jdtc_ros.core.types import Estimates
from phd_jdtc_ros.evaluation.metrics import ospa

from . import scans

# Time for a reply on a busy machine; a tracker usually replies within milliseconds.
REPLY_S = 20.0
# Time from the discovery by one side to that by the other.
SETTLE_S = 0.5
CUTOFF_M, ORDER = 1000.0, 2.0
TOPICS = tuple(names.detections(radar) for radar in ("radar_1", "radar_2"))


class Peer:
    """A ROS node with its own context, which is spun while its owner waits.

    Without a `domain` it is in the environment's.
    """

    def __init__(self, name: str, domain: int | None = None) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain)
        self.node = rclpy.create_node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def close(self) -> None:
        """End the node."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def spin_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Receive messages until `condition` holds; return whether it does."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            left = deadline - time.monotonic()
            if left <= 0.0:
                return False
            self._executor.spin_once(timeout_sec=min(left, 0.02))
        return True

    def spin(self, seconds: float) -> None:
        """Receive messages for a time."""
        self.spin_until(lambda: False, seconds)


class Radars(Peer):
    """Two radars and a listener in one node."""

    def __init__(self, domain: int) -> None:
        super().__init__("robustness_radars", domain)
        self.outputs = [self.node.create_publisher(PointCloud2, topic, 50) for topic in TOPICS]
        # Stamps of the filtered estimates, with their times of arrival (monotonic seconds).
        self.filtered: list[tuple[int, float]] = []
        self.answered: set[int] = set()
        # The filtered estimates by stamp; None for a cloud that cannot be decoded.
        self.found: dict[int, Estimates | None] = {}
        self.not_finite = 0  # Number of estimates and figures with values that are not finite
        # Time of arrival and statuses by name of every health report of the tracker.
        self.health: list[tuple[float, dict[str, DiagnosticStatus]]] = []
        for source, callback in (("filtered", self._on_filtered), ("smoothed", self._on_smoothed)):
            self.node.create_subscription(PointCloud2, names.estimates(source), callback, 1000)
        self.node.create_subscription(DiagnosticArray, names.cardinality(), self._on_figures, 1000)
        self.node.create_subscription(DiagnosticArray, names.DIAGNOSTICS, self._on_health, 100)

    def connected(self, timeout_s: float = 20.0) -> bool:
        """Wait until both directions to a tracker are connected; return whether they are."""

        def linked() -> bool:
            sending = all(output.get_subscription_count() for output in self.outputs)
            return sending and self.node.count_publishers(names.cardinality()) > 0

        found = self.spin_until(linked, timeout_s)
        self.spin(SETTLE_S)
        return found

    def keep(self, count: int) -> None:
        """Destroy all publishers but the first ones; another process can replace them."""
        while len(self.outputs) > count:
            self.node.destroy_publisher(self.outputs.pop())

    def send(self, index: int, stamp_ns: int | None = None) -> int:
        """Publish both radars' clouds of a scan; return its stamp."""
        stamp = scans.stamp_of_scan(index) if stamp_ns is None else stamp_ns
        for radar, output in enumerate(self.outputs):
            output.publish(scans.cloud(index, radar, stamp))
        return stamp

    def track(self, index: int, stamp_ns: int | None = None, timeout_s: float = REPLY_S) -> bool:
        """Send a scan and wait for its estimate; return whether it came."""
        stamp = self.send(index, stamp_ns)
        return self.wait_for({stamp}, timeout_s)

    def wait_for(self, stamps_ns: set[int], timeout_s: float = REPLY_S) -> bool:
        """Wait for an estimate with one of these stamps; return whether it came."""
        return self.spin_until(lambda: bool(stamps_ns & self.answered), timeout_s)

    def wait_for_more(self, before: int, timeout_s: float = REPLY_S) -> bool:
        """Wait until there are more filtered estimates than `before`; return whether there are."""
        return self.spin_until(lambda: len(self.filtered) > before, timeout_s)

    def ospa(self, index: int) -> float:
        """Return the OSPA distance of a scan's filtered estimates from the truth, metres."""
        found = self.found[scans.stamp_of_scan(index)]
        if found is None:
            raise RuntimeError(f"the estimates of scan {index} cannot be decoded")
        true, estimated = (each.position for each in (scans.truth()[index], found))
        return ospa(true, estimated, CUTOFF_M, ORDER).distance

    def nearest(self, place: Callable[[float], FloatArray]) -> float:
        """Return the distance of the latest estimates from a target, metres; infinite without any.

        `place` returns the target's position, metres, at a time since `scans.START_NS`, seconds.
        """
        stamp_ns, _ = self.filtered[-1]
        found = self.found[stamp_ns]
        if found is None or not len(found):
            return math.inf
        apart = found.position - place((stamp_ns - scans.START_NS) * 1e-9)
        return float(np.hypot(*apart.T).min())

    def flush(self) -> bool:
        """Let the tracker publish the scans it holds back; return whether it answered."""
        client = self.node.create_client(Trigger, f"{names.TRACKER}/flush")
        future = client.call_async(Trigger.Request())
        done = self.spin_until(future.done, REPLY_S)
        self.node.destroy_client(client)
        return done

    def latest_health(self) -> dict[str, DiagnosticStatus]:
        """Wait for a health report made after this call; return its statuses by name."""
        before = len(self.health)
        # The next report may have been made before this call.
        if not self.spin_until(lambda: len(self.health) > before + 1, REPLY_S):
            raise RuntimeError("the tracker sends no health report")
        return self.health[-1][1]

    def values(self, line: str) -> dict[str, str]:
        """Return the values of one status of a new health report, such as ``radar_1``."""
        return diagnostics.values_of(self.latest_health()[names.health(line)])

    def _on_filtered(self, cloud: PointCloud2) -> None:
        stamp = stamps.to_ns(cloud.header.stamp)
        self.filtered.append((stamp, time.monotonic()))
        self.answered.add(stamp)
        self.found[stamp] = self._decode(cloud)

    def _on_smoothed(self, cloud: PointCloud2) -> None:
        self._decode(cloud)

    def _decode(self, cloud: PointCloud2) -> Estimates | None:
        try:
            return estimates.from_msg(cloud)
        except RejectedMessageError:
            self.not_finite += 1
            return None

    def _on_figures(self, array: DiagnosticArray) -> None:
        values = diagnostics.values_of(array.status[0]).values()
        self.not_finite += any(not math.isfinite(float(value)) for value in values)

    def _on_health(self, array: DiagnosticArray) -> None:
        lines = {status.name: status for status in array.status}
        if names.health("step time") in lines:
            self.health.append((time.monotonic(), lines))
