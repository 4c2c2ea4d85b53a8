"""Compares estimates with the truth, scan by scan, and reports at the end."""

from __future__ import annotations

import json
import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.subscription import Subscription
from rich.console import Console
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64

from msg_adapters.encoding import RejectedMessageError, interfaces, names, quote
from msg_adapters.incoming.moving_radars import MESSAGE_TYPES
from msg_adapters.outgoing import diagnostics, outputs
from msg_adapters.targets import estimates, truth
from phd_jdtc_ros import output_files
from phd_jdtc_ros.configuration.parameters import replaced
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.arrays import IntArray
from phd_jdtc_ros.core.types import SOURCES, Estimates, Truth
from phd_jdtc_ros.evaluation.comparison import PointSet
from phd_jdtc_ros.evaluation.run_scores import ORDER, Evaluation, ScanScore
from phd_jdtc_ros.exit_status import FAILED, OK
from phd_jdtc_ros.parameter_files.node_tables import CLOUD, EVALUATOR
from phd_jdtc_ros.parameter_files.sections import ParameterFile
from phd_jdtc_ros.report.table import metrics, score_tables

from .common import parameters, runtime, topics
from .common.health import ThrottledWarnings
from .common.parameters import TrackerParameters
from .common.runtime import RunnableNode, steady_timer
from .recorder import Completion, ReceivedClouds, Recorder, watch_inputs

INPUT_DEPTH, OUTPUT_DEPTH = 100, 10
# Bounds of the memory of a node that may run for months: scans that a late cloud may belong to, and
# step times.
MAX_SCANS, MAX_STEPS = 1000, 100_000


class Evaluator(RunnableNode):
    """Compares estimates with the truth at their stamps and publishes every score."""

    CHECK_PERIOD_S = 0.1

    # Largest number of targets of a stamp: all distances between true and estimated ones are
    # computed, so that memory grows with the square, and the best assignment of 2000 takes a
    # second.
    MAX_TARGETS = 2000

    def __init__(self, files: Sequence[ParameterFile] = ()) -> None:
        super().__init__("evaluator")
        self._values = parameters.resolve(self, EVALUATOR, {}, files, replaced.EVALUATOR)
        self._report = _report_path(self._values["report"])
        self._classes = len(self._values["classes"])
        self._evaluation = Evaluation(
            self._classes, self._values["cutoff"], ORDER, MAX_SCANS, tuple(self._values["classes"])
        )
        self._truth_topic = self.resolve_topic_name(names.TRUTH)
        tracker = self._values["tracker"]
        self._received = ReceivedClouds(
            self._truth_topic, {s: names.estimates(s, tracker) for s in SOURCES}
        )
        self._frame: str | None = None
        self._warned_unmatched = False
        self._step_ms: deque[float] = deque(maxlen=MAX_STEPS)
        self._completion = Completion(self._evaluation, self._values["exit_after_scans"])
        self._warnings = ThrottledWarnings(self.get_logger())
        qos = topics.reliable(OUTPUT_DEPTH)
        self._scores = self.create_publisher(DiagnosticArray, "~/ospa", qos)
        self._curves = {
            quantity: self.create_publisher(Float64, f"~/plot/{quantity}", qos)
            for quantity in diagnostics.of_evaluator(self._classes)
        }
        self._engine: str | None = None
        self._has_parameters = False
        self._recorder = self._make_recorder()
        try:
            self._unconnected = self._subscribe()
        except Exception:
            if self._recorder is not None:
                self._recorder.close()
            raise
        # This follows all subscriptions, because DDS announces endpoints in the order of their
        # creation: a tracker that replies has discovered the subscriptions.
        TrackerParameters(self, tracker, self._on_parameters)
        # The timer runs by the wall clock, because simulated time stops with the replay, before the
        # last scores.
        steady_timer(self, self.CHECK_PERIOD_S, self._check)
        self.get_logger().info("waiting for estimates and truth")

    def _subscribe(self) -> list[Subscription]:
        """Subscribe to the truth and to the tracker, and return the subscriptions to the latter."""
        add, topic = self._evaluation.add_truth, self._truth_topic
        take: Callable[..., None] = partial(self._take, topic, truth.from_msg, add)
        topics.subscribe(self, PointCloud2, names.TRUTH, take, INPUT_DEPTH, names.TRUTH)
        figures = names.cardinality(self._values["tracker"])
        inputs: list[tuple[type, str, Callable[..., None]]] = [
            (DiagnosticArray, figures, self._on_figures)
        ]
        for source, topic in self._received.estimates.items():
            add_own = partial(self._evaluation.add_estimates, source)
            take = partial(self._take, topic, estimates.from_msg, add_own)
            inputs.append((PointCloud2, topic, take))
        return [
            topics.subscribe(
                self, message_type, topic, callback, INPUT_DEPTH, "tracker", self._values["tracker"]
            )
            for message_type, topic, callback in inputs
        ]

    def _make_recorder(self) -> Recorder | None:
        if not self._values["record"]:
            return None
        directory, tracker = Path(self._values["record"]), self._values["tracker"]
        recorded = {
            **_recorded_topics(self._values["record_topics"], self._values["record_types"]),
            self._truth_topic: names.CLOUD,
            **outputs.default_topics(
                self._classes,
                tracker,
                self._scores.topic_name,
                self.get_fully_qualified_name(),
                engine=None,
            ),
        }
        recorder = Recorder(self, directory, recorded, outputs.optional(tracker))
        watch_inputs(self, tracker, {self.resolve_topic_name(topic) for topic in recorded})
        return recorder

    def close(self) -> None:
        """Write the report, finish the recording, and warn of data that was not scored."""
        if self._recorder is not None:
            self._recorder.close()
        if any(self._evaluation.scored.values()):
            for line in self._received.gaps(self._evaluation):
                self.get_logger().warning(line)
        else:
            self._warn_of_no_score()
        summary = metrics(self._evaluation, np.array(self._step_ms), self._engine)
        if self._report is not None:
            self._write_report(self._report, summary)
        if summary["scans"]:
            Console().print(score_tables(summary))

    def _warn_of_no_score(self) -> None:
        """Log the reasons, and fail if scores were requested."""
        wanted = self._report is not None or self._values["exit_after_scans"]
        reasons = [self._received.no_score_reason(), *self._received.gaps(self._evaluation)]
        if wanted:
            self.get_logger().error("; ".join(reasons))
            self.exit_status = FAILED
        else:
            self.get_logger().warning("; ".join(reasons))

    def _write_report(self, path: Path, summary: Mapping[str, Any]) -> None:
        """Write the report; without scores, do not replace the report of an earlier run."""
        if not any(self._evaluation.scored.values()) and path.is_file():
            self.get_logger().error(
                f"report not written, because nothing was scored: {path} is still the report of an "
                "earlier run"
            )
            return
        try:
            _require_replaceable(path)
            output_files.write(path, json.dumps(summary, indent=2) + "\n")
        except OSError as error:  # The disk may have become full since the start
            self.get_logger().error(f"report not written: {path}: {error.strerror}")
            self.exit_status = FAILED

    def _take(
        self,
        topic: str,
        read: Callable[[PointCloud2], Truth | Estimates],
        add: Callable[[int, PointSet], Sequence[ScanScore]],
        cloud: PointCloud2,
        info: Mapping[str, int],
    ) -> None:
        """Score a cloud, unless it is not valid, which is counted and logged."""
        self._received.count_losses(topic, info.get("publication_sequence_number"))
        try:
            found = read(cloud)
            self._check_cloud(cloud.header.frame_id, found.class_id)
        except RejectedMessageError as error:
            self._received.refused[topic] += 1
            self._warnings.warn(topic, f"{topic}: {error}")
            return
        self._received.take(topic, found.stamp_ns)
        self._publish(add(found.stamp_ns, PointSet.of(found)))

    def _check_cloud(self, frame: str, class_id: IntArray) -> None:
        """Refuse a cloud with another frame, unknown classes or too many targets."""
        self._frame = self._frame or frame
        largest, classes = class_id.max(initial=-1), self._classes
        if frame != self._frame:
            text = f"frame_id is {quote(frame)}, must be {self._frame!r} as in the first cloud"
            raise RejectedMessageError("frame", text)
        if largest >= classes:
            text = f"class_id is {largest}, must be less than {classes}, the number of names in "
            raise RejectedMessageError("schema", f"{text}classes")
        if len(class_id) > self.MAX_TARGETS:
            text = f"{len(class_id)} targets, at most {self.MAX_TARGETS} are allowed"
            raise RejectedMessageError("oversize", text)

    def _on_parameters(self, values: Mapping[str, Any]) -> None:
        """Use and record the tracker's parameters, sent once it has discovered this node."""
        self._evaluation.least_speed = least_speed(values)
        engine = values.get("engine")
        self._engine = None if engine is None else str(engine)
        if self._recorder is not None:
            self._recorder.write_parameters(values)
        self._has_parameters = True

    def _on_figures(self, message: DiagnosticArray) -> None:
        for status in message.status:
            text = diagnostics.values_of(status).get("step_ms")
            if text is None:
                continue
            try:
                step_ms = float(text)
            except ValueError:
                step_ms = math.nan
            if math.isfinite(step_ms):
                self._step_ms.append(step_ms)
            else:
                topic = names.cardinality(self._values["tracker"])
                text = f"{topic}: step_ms is {text!r}, must be a finite number"
                self._warnings.warn(topic, text)

    def _publish(self, scores: Sequence[ScanScore]) -> None:
        for score in scores:
            self._scores.publish(diagnostics.score_to_msg(score, self._values["cutoff"], ORDER))
            for quantity, message in diagnostics.score_to_msgs(score).items():
                self._curves[quantity].publish(message)

    def _check(self) -> None:
        """Log the connection to the tracker and missing matches, and end when complete."""
        if self._has_parameters and self._unconnected:
            self._unconnected = [sub for sub in self._unconnected if not sub.get_publisher_count()]
            if not self._unconnected:
                self.get_logger().info(f"connected to {self._values['tracker']}")
        if not self._warned_unmatched and (text := self._received.mismatch(self._evaluation)):
            self._warned_unmatched = True
            self.get_logger().warning(text)
        recorder, topic = self._recorder, self._scores.topic_name
        recorded = 0 if recorder is None else recorder.written[topic]
        if self._completion.is_reached(time.monotonic(), recorded):
            self.exit_status = OK


def least_speed(values: Mapping[str, Any]) -> float:
    """Return the speed of the slowest targets that a tracker with these parameters reports, m/s.

    Slower ones are in the clutter maps of all sensors.
    """
    own = [name for name in values.get("sensors", ()) if values.get(f"{name}.kind") != "reports"]
    if not all(values.get(f"{name}.clutter_map") for name in own):
        return 0.0
    return min((float(values[f"{name}.clutter_map_speed"]) for name in own), default=0.0)


def _recorded_topics(topics: Sequence[str], messages: Sequence[str]) -> dict[str, str]:
    """Return the message type of each of ``record_topics``, given ``record_types``."""
    if messages and len(messages) != len(topics):
        raise ConfigError(
            f"record_types: {messages} given, must be empty or one for each of {len(topics)} topics"
        )
    kinds = {CLOUD: names.CLOUD, **MESSAGE_TYPES}
    listed = messages or [CLOUD] * len(topics)
    found = {topic: kinds[kind] for topic, kind in zip(topics, listed, strict=True)}
    for kind in found.values():
        if interfaces.installed_class(kind) is None:
            package = kind.split("/")[0]
            raise ConfigError(f"record_types: {messages} given, but {package} is not installed")
    return found


def _report_path(given: str) -> Path | None:
    """Return the path of the report and create its directory; None if no report is wanted."""
    if not given:
        return None
    path = Path(given)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _require_replaceable(path)
    except OSError as error:
        raise ConfigError(f"report: {given} given, {error.filename}: {error.strerror}") from error
    if lack := output_files.why_closed(path.parent):
        raise ConfigError(f"report: {given} given, {lack}")
    return path


def _require_replaceable(path: Path) -> None:
    """Raise `OSError` with what is at a path if it is neither a report nor nothing."""
    output_files.require_replaceable(path, "report", f'{{\n  "{SOURCES[0]}": '.encode())


def main(argv: Sequence[str]) -> int:
    """Run the evaluator node."""
    files = parameters.given_files("evaluator", __doc__, argv)
    return runtime.run("evaluator", lambda: Evaluator(files), argv)
