"""The live tracker: detections in, filtered and smoothed estimates out."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from msg_adapters import detections, diagnostics, estimates, markers
from msg_adapters.errors import RejectedMessageError
from phd_jdtc_ros.core import config
from phd_jdtc_ros.core.engine import Engine, Step
from phd_jdtc_ros.core.parameters import schema
from phd_jdtc_ros.core.scans import Rejection, Reset, ScanGrouper
from phd_jdtc_ros.core.types import Estimates, Scan

from . import parameters, runtime

WARNING_PERIOD_S = 5.0

INPUT_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
OUTPUT_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
MARKER_QOS = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


class Tracker(Node):
    """Subscribes to every radar, steps the engine scan by scan, publishes what comes out."""

    def __init__(self) -> None:
        super().__init__("tracker")
        given = parameters.given(self)
        self._config = config.resolve(given)
        parameters.declare(self, schema(given), self._config.values)
        self.exit_status: int | None = None
        modes = self._config.model.modes
        self._class_names = tuple(model.name for model in modes.classes)
        self._engine: Engine = self._config.engine()
        self._grouper = ScanGrouper(len(self._config.inputs), self._config.reset_threshold_s)
        self._received: Counter[str] = Counter()
        self._dropped: Counter[tuple[str, str]] = Counter()
        self._neutral: set[str] = set()
        self._epoch = 0
        self._cpu_s = 0.0
        self._last_step_ms = 0.0
        self._make_publishers()
        self._make_inputs()
        self.create_service(Trigger, "~/flush", self._on_flush)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_timer(1.0, self._publish_health)
        if not self._config.model.births and not self._config.model.detection_births.enabled:
            self.get_logger().warning(
                "neither births nor detection_births.rates are set: no target can ever appear"
            )
        self.get_logger().info(
            f"tracking {len(self._class_names)} classes with {len(self._config.inputs)} radars"
        )

    def close(self) -> None:
        """Say how the run went."""
        self.get_logger().info(f"stopped; {self._summary()}")

    def _make_publishers(self) -> None:
        def cloud(source: str) -> Any:
            return self.create_publisher(PointCloud2, f"~/{source}/estimates", OUTPUT_QOS)

        def poses(source: str) -> list[Any]:
            return [
                self.create_publisher(PoseArray, f"~/{source}/class_{k}/poses", OUTPUT_QOS)
                for k in range(len(self._class_names))
            ]

        self._clouds = {source: cloud(source) for source in ("filtered", "smoothed")}
        self._poses = {source: poses(source) for source in ("filtered", "smoothed")}
        self._markers = self.create_publisher(MarkerArray, "~/markers", MARKER_QOS)
        self._cardinality = self.create_publisher(DiagnosticArray, "~/cardinality", OUTPUT_QOS)
        self._health = self.create_publisher(DiagnosticArray, "/diagnostics", OUTPUT_QOS)

    def _make_inputs(self) -> None:
        for index, radar in enumerate(self._config.inputs):
            try:
                self.create_subscription(
                    PointCloud2,
                    radar.topic,
                    partial(self._on_detections, index),
                    INPUT_QOS,
                    qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                )
            except RuntimeError as error:  # what rclpy raises for a policy it does not know
                raise config.ConfigError([f"qos_overrides.{radar.topic}: {error}"]) from error

    def _on_detections(self, index: int, cloud: PointCloud2) -> None:
        start = time.thread_time()
        radar = self._config.inputs[index]
        self._received[radar.name] += 1
        try:
            report = detections.from_msg(cloud, radar)
        except RejectedMessageError as error:
            self._drop(radar.name, error.reason, f"scan rejected: {error}")
            return
        for reason, count in report.dropped.items():
            self._drop(radar.name, reason, f"{count} points dropped: {reason}", count)
        if report.detections.amplitude is None and radar.name not in self._neutral:
            self._neutral.add(radar.name)
            self.get_logger().warning(
                f"{radar.topic}: no field {radar.amplitude_field!r}; "
                "its amplitudes say nothing of the class"
            )
        events = self._grouper.add(index, report.stamp_ns, report.detections)
        if isinstance(events, Rejection):
            self._drop(radar.name, events.value, f"scan rejected: {events.value} stamp")
            return
        self._handle(events, start)

    def _handle(self, events: Sequence[Scan | Reset], start: float) -> None:
        """Step through closed scans; `start` is the CPU time when their last report came."""
        for event in events:
            if isinstance(event, Reset):
                self.get_logger().warning("stamps jumped back: starting anew")
                self._publish_flushed()
                self._epoch += 1
                continue
            step = self._engine.step(event)
            self._publish_estimates("filtered", step.filtered)
            for smoothed in step.smoothed:
                self._publish_estimates("smoothed", smoothed)
            self._markers.publish(
                markers.to_msg(step.filtered, self._config.world_frame, self._class_names)
            )
            now = time.thread_time()
            self._last_step_ms = 1e3 * (self._cpu_s + now - start)
            self._cpu_s, start = 0.0, now
            self._publish_cardinality(step)
        self._cpu_s += time.thread_time() - start if not events else 0.0

    def _publish_estimates(self, source: str, found: Estimates) -> None:
        frame = self._config.world_frame
        self._clouds[source].publish(estimates.to_msg(found, frame))
        for class_id, publisher in enumerate(self._poses[source]):
            publisher.publish(estimates.to_pose_array(found, class_id, frame))

    def _publish_cardinality(self, step: Step) -> None:
        mass = {name: float(m) for name, m in zip(self._class_names, step.class_mass, strict=True)}
        values = {
            "total": float(np.sum(step.class_mass)),
            **mass,
            "particles": step.particles,
            "effective_sample_size": step.effective_sample_size,
            "unresolved": step.filtered.unresolved,
            "orphans": step.orphans,
            "step_ms": self._last_step_ms,
        }
        self._cardinality.publish(
            diagnostics.array(
                step.filtered.stamp_ns, [diagnostics.status("tracker/cardinality", values)]
            )
        )

    def _publish_flushed(self) -> int:
        flushed = self._engine.flush()
        for found in flushed:
            self._publish_estimates("smoothed", found)
        return len(flushed)

    def _on_flush(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._handle(self._grouper.close_all(), time.thread_time())
        self._grouper.reset()
        count = self._publish_flushed()
        response.success = True
        response.message = f"{count} smoothed estimates published"
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._grouper.reset()
        self._engine.reset()
        response.success = True
        response.message = "reset"
        return response

    def _drop(self, radar: str, reason: str, text: str, count: int = 1) -> None:
        self._dropped[radar, reason] += count
        self.get_logger().warning(f"{radar}: {text}", throttle_duration_sec=WARNING_PERIOD_S)

    def _summary(self) -> str:
        received = sum(self._received.values())
        drops = [f"{radar} {reason} {n}" for (radar, reason), n in sorted(self._dropped.items())]
        return f"{received} clouds received, dropped: {', '.join(drops) or 'none'}"

    def _publish_health(self) -> None:
        statuses = [self._radar_status(radar.name) for radar in self._config.inputs]
        period_ms = 1e3 * self._config.model.modes.interval_s
        late = self._last_step_ms > period_ms
        statuses.append(
            diagnostics.status(
                "tracker/step",
                {"step_ms": self._last_step_ms, "scan_period_ms": period_ms, "epoch": self._epoch},
                DiagnosticStatus.WARN if late else DiagnosticStatus.OK,
                "slower than the scans" if late else "in time",
            )
        )
        now_ns = self.get_clock().now().nanoseconds
        self._health.publish(diagnostics.array(now_ns, statuses))

    def _radar_status(self, name: str) -> DiagnosticStatus:
        drops = {reason: n for (radar, reason), n in self._dropped.items() if radar == name}
        received = self._received[name]
        level, text = DiagnosticStatus.OK, "receiving"
        if not received:
            level, text = DiagnosticStatus.STALE, "nothing received yet"
        elif drops:
            level, text = DiagnosticStatus.WARN, "some input was dropped"
        values = {"received": received, **{f"dropped_{k}": v for k, v in drops.items()}}
        return diagnostics.status(f"tracker/{name}", values, level, text)


def main(argv: Sequence[str]) -> int:
    """Run the tracker node."""
    return runtime.run("tracker", Tracker, argv)
