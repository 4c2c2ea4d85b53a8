# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compares estimates with the truth, scan by scan, and reports at the end."""

from __future__ import annotations

import json
import math
import os
import time
from collections import deque
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rich.console import Console
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64

from msg_adapters import diagnostics, estimates, names, plots, quantities, truth
from msg_adapters.errors import RejectedMessageError
from phd_jdtc_ros.core.configuration.schema import SMALL, ConfigError, Parameter
from phd_jdtc_ros.core.evaluation.evaluation import Evaluation
from phd_jdtc_ros.core.evaluation.scan_scores import PointSet, ScanScore
from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.exit_status import FAILED, OK
from phd_jdtc_ros.report.table import metrics, score_tables

from ..common import arguments, overridable, parameters, runtime
from ..common.parameter_files import ParameterFile
from ..common.runtime import WARNING_PERIOD_S
from .recorder import Recorder

INPUT_DEPTH = 100
OUTPUT_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
CHECK_PERIOD_S = 0.1
# Time after the last score in which further messages can still arrive for the recording.
LINGER_S = 0.5
# Bounds of the memory of a node that may run for months: scans that a late cloud may belong to, and
# step times.
KEPT_SCANS, KEPT_STEPS = 1000, 100_000

TABLE = (
    Parameter("tracker", names.TRACKER, "Full name of the tracker node."),
    Parameter("truth_topic", names.TRUTH, "Topic of the truth."),
    Parameter("classes", 2, "Number of target classes.", 1, 1000),
    Parameter(
        "class_names",
        [],
        "Names of the classes in the tables, in order; class 0 and so on if empty.",
        element=str,
    ),
    Parameter("cutoff", 1000.0, "OSPA's c, m.", SMALL),
    Parameter("order", 2.0, "OSPA's p.", 1.0, 100.0),
    Parameter(
        "publish_plots", True, "Publish ~/plot/..., one number per topic for plotting tools."
    ),
    Parameter("report", "", "Path of the final report (JSON); none if empty."),
    Parameter("record", "", "Directory of a bag of everything published; none if empty."),
    Parameter(
        "radar_topics",
        [names.detections("radar_1"), names.detections("radar_2")],
        "Detections to record too.",
        element=str,
    ),
    Parameter(
        "exit_after_scans",
        0,
        "End once this many stamps are smoothed and scored; 0 never.",
        0,
        10**9,
    ),
)


class Evaluator(Node):
    """Compares estimates with the truth at their stamps and publishes every score."""

    def __init__(self, files: Sequence[ParameterFile] = ()) -> None:
        super().__init__("evaluator")
        self._values = parameters.resolve(self, TABLE, {}, files)
        self.exit_status: int | None = None
        self._report = _report_path(self._values["report"])
        self._evaluation = Evaluation(
            self._values["classes"],
            self._values["cutoff"],
            self._values["order"],
            KEPT_SCANS,
            _class_names(self._values),
        )
        self._step_ms: deque[float] = deque(maxlen=KEPT_STEPS)
        self._complete_since: float | None = None
        self._scores = self.create_publisher(DiagnosticArray, "~/ospa", OUTPUT_QOS)
        self._plots = {
            quantity: self.create_publisher(Float64, f"~/plot/{quantity}", OUTPUT_QOS)
            for quantity in quantities.of_evaluator(self._values["classes"])
            if self._values["publish_plots"]
        }
        self._recorder = self._make_recorder()
        self._subscribe()
        # By the wall clock, because simulated time stops with the replay, before the last scores.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(CHECK_PERIOD_S, self._check_complete, clock=steady)
        self.get_logger().info("waiting for estimates and truth")

    def _subscribe(self) -> None:
        tracker = self._values["tracker"]
        inputs = [
            (PointCloud2, self._values["truth_topic"], self._on_truth),
            *(
                (PointCloud2, names.estimates(source, tracker), partial(self._on_estimates, source))
                for source in SOURCES
            ),
            (DiagnosticArray, names.cardinality(tracker), self._on_figures),
        ]
        for message_type, topic, callback in inputs:
            overridable.subscribe(self, message_type, topic, callback, INPUT_DEPTH)

    def _make_recorder(self) -> Recorder | None:
        if not self._values["record"]:
            return None
        topics = {
            **dict.fromkeys(self._values["radar_topics"], names.CLOUD),
            self._values["truth_topic"]: names.CLOUD,
            **names.published(
                self._values["classes"],
                self._values["tracker"],
                self._scores.topic_name,
                self.get_fully_qualified_name(),
            ),
        }
        return Recorder(self, Path(self._values["record"]), topics)

    def close(self) -> None:
        """Write the report and finish the recording."""
        if self._recorder is not None:
            self._recorder.close()
        summary = metrics(self._evaluation, np.array(self._step_ms))
        if self._report is not None:
            try:
                self._report.write_text(json.dumps(summary, indent=2) + "\n")
            except OSError as error:  # the disk may have become full since the start
                self.get_logger().error(f"no report: {self._report}: {error.strerror}")
                self.exit_status = FAILED
        if summary["scans"]:
            Console().print(score_tables(summary))

    def _on_truth(self, cloud: PointCloud2) -> None:
        try:
            targets = truth.from_msg(cloud)
        except RejectedMessageError as error:
            self._warn(f"{self._values['truth_topic']}: {error}")
            return
        self._publish(self._evaluation.add_truth(targets.stamp_ns, PointSet.of(targets)))

    def _on_estimates(self, source: str, cloud: PointCloud2) -> None:
        try:
            received = estimates.from_msg(cloud)
        except RejectedMessageError as error:
            self._warn(f"{source} estimates: {error}")
            return
        points = PointSet.of(received)
        self._publish(self._evaluation.add_estimates(source, received.stamp_ns, points))

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
                self._warn(f"{topic}: step_ms is {text!r}, must be a finite number")

    def _publish(self, scores: Sequence[ScanScore]) -> None:
        for score in scores:
            self._scores.publish(
                diagnostics.score_to_msg(score, self._values["cutoff"], self._values["order"])
            )
            if self._plots:
                for quantity, message in plots.score_to_msgs(score).items():
                    self._plots[quantity].publish(message)

    def _check_complete(self) -> None:
        """End `LINGER_S` after the wanted number of stamps has the scores of both sources."""
        wanted = self._values["exit_after_scans"]
        if not wanted or min(self._evaluation.scored.values()) < wanted:
            return
        now = time.monotonic()
        self._complete_since = self._complete_since or now
        if now - self._complete_since >= LINGER_S:
            self.exit_status = OK

    def _warn(self, text: str) -> None:
        self.get_logger().warning(text, throttle_duration_sec=WARNING_PERIOD_S)


def _class_names(values: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the classes; none if they are not given.

    Raises
    ------
    ConfigError
        If there are not as many as classes.
    """
    names, classes = values["class_names"], values["classes"]
    if names and len(names) != classes:
        raise ConfigError([f"class_names: {names} given, must be empty or {classes} names"])
    return tuple(names)


def _report_path(given: str) -> Path | None:
    """Return the path of the report and create its directory; None if no report is wanted.

    Raises
    ------
    ConfigError
        If the report cannot be written there.
    """
    if not given:
        return None
    path = Path(given)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError([f"report: {given} given, {path.parent}: {error.strerror}"]) from error
    if os.path.isdir(path) or not os.access(path if os.path.exists(path) else path.parent, os.W_OK):
        raise ConfigError([f"report: {given} given, cannot be written"])
    return path


def main(argv: Sequence[str]) -> int:
    """Run the evaluator node."""
    files = arguments.check("evaluator", __doc__, argv)
    return runtime.run("evaluator", lambda: Evaluator(files), argv)
