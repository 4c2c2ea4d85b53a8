# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""A scan's way through the live node: decode, group, step, publish.

What a tracker has from its configuring to its clean-up.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from sensor_msgs.msg import PointCloud2

from msg_adapters import detections, radar_scan
from msg_adapters.errors import RejectedMessageError
from phd_jdtc_ros.core.configuration.radar_input import RadarInput
from phd_jdtc_ros.core.configuration.schema import ConfigError
from phd_jdtc_ros.core.scans import Rejection, Reset
from phd_jdtc_ros.core.types import SMOOTHED, Estimates, Scan

from ..common.runtime import WARNING_PERIOD_S
from . import endpoints
from .checkpoint import Checkpoints
from .health import InputHealth, OutputHealth, Rhythm, StepHealth
from .outputs import Outputs
from .settings import Settings


class LiveTracker:
    """Subscribes to every radar, steps the engine scan by scan, publishes what comes out.

    Parameters
    ----------
    node : LifecycleNode
    settings : Settings

    Raises
    ------
    ConfigError
        If a topic's QoS cannot be as it was given.
    """

    def __init__(self, node: LifecycleNode, settings: Settings) -> None:
        self._node = node
        self._settings = settings
        config = settings.config
        nominal_s = config.model.modes.interval_s
        self._engine = config.engine()
        self._grouper = config.grouper()
        self._inputs = [
            InputHealth(radar.name, radar.topic, Rhythm(nominal_s)) for radar in config.inputs
        ]
        self._pace = StepHealth(Rhythm(nominal_s))
        self._served = OutputHealth()
        self._active = False
        self._neutral: set[str] = set()
        self._cpu_s = 0.0
        self._subscriptions: list[Subscription] = []
        self._outputs = Outputs(node, settings, self._served)
        self._patience = self._make_patience(settings.node["max_wait_s"])
        try:
            self._checkpoints = self._make_checkpoints()
            for index, health in enumerate(self._inputs):
                message_class, read = _reader(config.inputs[index])
                self._subscriptions.append(
                    endpoints.subscription(
                        node, message_class, partial(self._on_detections, index, read), health
                    )
                )
        except Exception:
            self.destroy()
            raise

    def _make_patience(self, seconds: float) -> Timer | None:
        """Return a stopped timer for the longest wait by the wall clock, if there is one."""
        if not seconds:
            return None
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        return self._node.create_timer(seconds, self._on_overdue, clock=clock, autostart=False)

    def _make_checkpoints(self) -> Checkpoints | None:
        own = self._settings.node
        if not own["checkpoint.path"]:
            return None
        # Where pathlib raises if it may not look, os.path finds nothing.
        path = Path(os.path.expanduser(own["checkpoint.path"]))
        if not os.path.isdir(path.parent):
            raise ConfigError([f"checkpoint.path: {path} given, {path.parent} is no directory"])
        if os.path.isdir(path):
            raise ConfigError([f"checkpoint.path: {path} given, must be a file, is a directory"])
        fixed = {
            name: value
            for name, value in self._settings.config.values.items()
            if name not in self._settings.mutable
        }
        return Checkpoints(
            path,
            own["checkpoint.every"],
            # What is predicted over after a restart is a gap like any other.
            min(own["checkpoint.max_age_s"], self._settings.config.max_gap_s),
            fixed,
            self._node.get_logger(),
        )

    def destroy(self) -> None:
        """Take all topics back."""
        while self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.pop())
        if self._patience is not None:
            self._node.destroy_timer(self._patience)
            self._patience = None
        self._outputs.destroy()

    def start(self) -> None:
        """Take in what the radars say from now on."""
        self._active = True

    def stop(self) -> None:
        """Publish what is still held back and take in nothing more."""
        self.flush()
        self._active = False

    def retune(self, settings: Settings) -> None:
        """Go by changed settings from the next scan on; their structure must be the same."""
        self._settings = settings
        self._engine.retune(settings.config.model, settings.config.existence_threshold)
        self._outputs.show_markers(settings.node["publish_markers"])

    def flush(self) -> int:
        """Close all scans, publish all smoothed estimates, begin anew; return their number."""
        self._handle(self._grouper.close_all(), time.thread_time())
        self._grouper.reset()
        return self._end_run(self._engine.flush())

    def save(self) -> str | None:
        """Write a checkpoint; return why there is none, or None."""
        if self._checkpoints is None:
            return "checkpoint.path is not set"
        return self._checkpoints.save(self._engine)

    def reset(self) -> None:
        """Begin anew and publish nothing."""
        self._grouper.reset()
        self._engine.reset()
        self._begin_run()
        self._outputs.clear_markers()

    def _begin_run(self) -> None:
        if self._checkpoints is not None:
            self._checkpoints.discard()
        self._outputs.forget()
        self._pace.rhythm.pause()
        if self._patience is not None:
            self._patience.cancel()

    def _end_run(self, rest: Sequence[Estimates]) -> int:
        """Publish the smoothed estimates that were held back; return their number."""
        for found in rest:
            self._outputs.publish_estimates(SMOOTHED, found)
        self._begin_run()
        return len(rest)

    def _on_detections(
        self,
        index: int,
        read: Callable[[Any, RadarInput], detections.Report],
        message: Any,
        info: Mapping[str, int],
    ) -> None:
        if not self._active:
            return
        start = time.thread_time()
        radar, health = self._settings.config.inputs[index], self._inputs[index]
        health.arrived(time.monotonic(), info.get("publication_sequence_number"))
        try:
            report = read(message, radar)
        except RejectedMessageError as error:
            self._drop(health, error.reason, f"scan rejected: {error}")
            return
        for reason, count in report.dropped.items():
            self._drop(health, reason, f"{count} points dropped: {reason}", count)
        if report.detections.amplitude is None and radar.name not in self._neutral:
            self._neutral.add(radar.name)
            self._node.get_logger().warning(
                f"{radar.topic}: no field {radar.amplitude_field!r}; "
                "its amplitudes say nothing of the class"
            )
        waiting = self._grouper.waiting
        events = self._grouper.add(index, report.stamp_ns, report.detections)
        if isinstance(events, Rejection):
            self._drop(health, events.value, f"scan rejected: {events.value} stamp")
            return
        health.rhythm.beat(time.monotonic())
        self._handle(events, start)
        if self._patience is not None:
            self._wait(anew=bool(events) or not waiting)

    def _wait(self, anew: bool) -> None:
        """Time the wait for the rest of a scan, if there is one; `anew` if it is another scan."""
        if not self._grouper.waiting:
            self._patience.cancel()
        elif anew:
            self._patience.reset()

    def _on_overdue(self) -> None:
        self._patience.cancel()
        events = self._grouper.close_all()
        self._pace.closed_by_wait += sum(isinstance(event, Scan) for event in events)
        self._handle(events, time.thread_time())

    def _handle(self, events: Sequence[Scan | Reset], start: float) -> None:
        """Step through closed scans; `start` is the CPU time when their last report came."""
        for event in events:
            if isinstance(event, Reset):
                limit = ", more than max_gap_scans" if event.ahead else ""
                self._node.get_logger().warning(f"{event}{limit}: starting anew")
                self._end_run(self._engine.interrupt() if event.ahead else self._engine.flush())
                self._pace.epoch += 1
                continue
            if self._checkpoints is not None:
                self._checkpoints.resume(self._engine, event.stamp_ns)
            step = self._engine.step(event)
            self._outputs.publish_filtered(step.filtered)
            for smoothed in step.smoothed:
                self._outputs.publish_estimates(SMOOTHED, smoothed)
            now = time.thread_time()
            step_ms = 1e3 * (self._cpu_s + now - start)
            self._cpu_s, start = 0.0, now
            self._pace.stepped(event.stamp_ns, step_ms)
            if self._checkpoints is not None:
                self._checkpoints.stepped(self._engine)
            self._outputs.publish_cardinality(step, step_ms)
        self._cpu_s += time.thread_time() - start if not events else 0.0

    def _drop(self, health: InputHealth, reason: str, text: str, count: int = 1) -> None:
        health.drop(reason, count, time.monotonic())
        self._node.get_logger().warning(
            f"{health.name}: {text}", throttle_duration_sec=WARNING_PERIOD_S
        )

    def silent(self) -> frozenset[str]:
        """Return the names of the radars that have fallen silent."""
        now, scans = time.monotonic(), self._settings.node["silent_after_scans"]
        return frozenset(radar.name for radar in self._inputs if radar.silent(now, scans))

    def statuses(self) -> list[DiagnosticStatus]:
        """Return a line for each radar, one for the step time and one for the outputs."""
        now, name = time.monotonic(), self._node.get_name()
        hardware_id = self._node.get_fully_qualified_name()
        own = self._settings.node
        return [
            *(
                health.status(
                    name,
                    now,
                    own["silent_after_scans"],
                    endpoints.publishers(self._node, listener),
                )
                for health, listener in zip(self._inputs, self._subscriptions, strict=True)
            ),
            self._pace.status(name, hardware_id, own["step_time_limit"]),
            self._served.status(name, hardware_id, now),
        ]

    def summary(self) -> str:
        """Say how the run went."""
        received = sum(health.received for health in self._inputs)
        drops = [
            f"{health.name} {reason} {count}"
            for health in self._inputs
            for reason, count in sorted(health.dropped.items())
        ]
        return f"{received} clouds received, dropped: {', '.join(drops) or 'none'}"


def _reader(radar: RadarInput) -> tuple[type, Callable[[Any, RadarInput], detections.Report]]:
    """Return the class of a radar's messages and what reads them."""
    if radar.message == "point_cloud":
        return PointCloud2, detections.from_msg
    message_class = radar_scan.installed()
    if message_class is None:
        raise ConfigError(
            [f"{radar.name}.message: {radar.message} given, but radar_msgs is not installed"]
        )
    return message_class, radar_scan.from_msg
