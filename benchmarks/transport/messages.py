"""The node's own cost: decoding, encoding and publishing a large scan.

The tracker node itself runs in this process, with an engine that always finds the same 200 targets
at no cost. The parts are measured separately, with the functions that the node calls.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseArray
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import set_logger_level
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from msg_adapters.incoming import detections
from msg_adapters.outgoing import diagnostics
from msg_adapters.targets import estimates, markers, tracks
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.engine import OnFiltered, Step, ignore_filtered
from phd_jdtc_ros.core.state_space import PLANAR
from phd_jdtc_ros.core.types import Detections, Estimates, Scan
from phd_jdtc_ros.nodes.tracker.node import Tracker

from ..timing import Case, interleaved, spread

DETECTIONS, ESTIMATES = 1000, 200
STAMP_S = 1000
FRAME = "map"
WHOLE = "the node"


def environment() -> None:
    """Keep messages on this machine, apart from other ROS processes, without shared memory."""
    os.environ["ROS_DOMAIN_ID"] = os.environ.get("ROS_DOMAIN_ID") or str(1 + os.getpid() % 100)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"


def measure(quick: bool) -> dict[str, Any]:
    """Return the CPU time of the node's work on a scan, and of the parts of it.

    A scan is two clouds of 500 detections. Its outputs are 200 filtered and 200 smoothed estimates:
    a cloud and one pose array per class for both, and markers for the filtered ones.
    """
    environment()
    set_logger_level("tracker", LoggingSeverity.WARN)
    rclpy.init()
    node = Tracker()
    try:
        _subscribe_all(node)
        calls = {WHOLE: _whole(node), **_parts(node)}
        times = interleaved({n: Case(call, 20 if quick else 100) for n, call in calls.items()})
    finally:
        node.destroy_node()
        rclpy.shutdown()
    each = {name: spread(values) for name, values in times.items()}
    return {"total_ms": each.pop(WHOLE)["median_ms"], "parts": each}


def step_at_no_cost(engine: Any, found: Estimates, classes: int) -> None:
    """Let an engine find the same targets in every scan, filtered and smoothed.

    It is the engine that the pipeline has already, which is known in several places.
    """
    mass = np.full(classes, len(found) / classes)
    figures = {name: 0.0 for names in diagnostics.FIGURES.values() for name in names}
    always = Step(filtered=(found,), smoothed=(found,), class_mass=mass, figures=figures)

    def step(scan: Scan, on_filtered: OnFiltered = ignore_filtered) -> Step:
        on_filtered(always.filtered)
        return always

    engine.step = step


def _subscribe_all(node: Any) -> None:
    """Subscribe to all of the node's topics, so that its messages are also sent."""
    for publisher in list(node.publishers):
        node.create_subscription(
            publisher.msg_type, publisher.topic_name, lambda _: None, publisher.qos_profile
        )


def _whole(node: Any) -> Callable[[], None]:
    """Return a function that passes the node one scan after the other."""
    config = resolve({})
    # Without the engine's own work, which is measured elsewhere.
    step_at_no_cost(node._live._pipeline.engine, _estimates(2), 2)
    subscriptions = {subscription.topic_name: subscription for subscription in node.subscriptions}
    # Two scans alternate, because the tracker warns of a cloud that repeats the one before.
    inputs = [
        [
            (subscriptions[radar.topic].callback, detections.to_msg(report, 0, radar.frame))
            for report, radar in zip(_reports(len(config.radars), seed), config.radars, strict=True)
        ]
        for seed in range(2)
    ]
    stamp_s = STAMP_S

    def send_scan() -> None:
        nonlocal stamp_s
        stamp_s += 1
        for callback, cloud in inputs[stamp_s % 2]:
            cloud.header.stamp.sec = stamp_s
            callback(cloud, {"publication_sequence_number": stamp_s})

    return send_scan


def _parts(node: Any) -> dict[str, Callable[[], None]]:
    """Return the parts of the node's work outside the engine, by name."""
    config = resolve({})
    names = tuple(model.name for model in config.model.modes.classes)
    clouds = [
        (detections.to_msg(report, STAMP_S * 10**9, radar.frame), radar)
        for report, radar in zip(_reports(len(config.radars), 0), config.radars, strict=True)
    ]
    found = _estimates(len(names))
    outputs = {
        kind: node.create_publisher(kind, f"~/benchmark/{kind.__name__}", 10)
        for kind in (PointCloud2, PoseArray, MarkerArray)
    }
    for kind, publisher in outputs.items():
        node.create_subscription(kind, publisher.topic_name, lambda _: None, 10)

    def decode() -> None:
        for cloud, radar in clouds:
            detections.from_msg(cloud, radar)

    def publish_clouds() -> None:
        for _ in ("filtered", "smoothed"):
            outputs[PointCloud2].publish(estimates.to_cdr(found, FRAME))

    def publish_poses() -> None:
        for _ in ("filtered", "smoothed"):
            for class_id in range(len(names)):
                outputs[PoseArray].publish(tracks.poses_to_cdr(found, class_id, FRAME))

    def publish_markers() -> None:
        outputs[MarkerArray].publish(markers.to_cdr(found, FRAME, names))

    return {
        "decode two clouds": decode,
        "encode and publish two clouds": publish_clouds,
        "encode and publish four pose arrays": publish_poses,
        "encode and publish markers": publish_markers,
    }


def _reports(radars: int, seed: int) -> list[Detections]:
    rng = np.random.default_rng(seed)
    count = DETECTIONS // radars
    return [
        Detections(
            np.stack([rng.uniform(0.0, 15e3, count), rng.uniform(-3.0, 3.0, count)], axis=1),
            rng.uniform(4.0, 50.0, count),
        )
        for _ in range(radars)
    ]


def _estimates(classes: int) -> Estimates:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(ESTIMATES, len(PLANAR), len(PLANAR)))
    probability = rng.dirichlet(np.ones(classes), ESTIMATES)
    return Estimates(
        stamp_ns=STAMP_S * 10**9,
        lag=0,
        state=1e3 * rng.normal(size=(ESTIMATES, len(PLANAR))),
        covariance=1e3 * root @ root.transpose(0, 2, 1),
        weight=np.ones(ESTIMATES),
        class_probability=probability,
        class_id=probability.argmax(axis=1),
        track_id=np.zeros(ESTIMATES, dtype=np.int64),
    )
