"""The parameters of the evaluator node."""

from __future__ import annotations

from dataclasses import dataclass

from msg_adapters import names
from phd_jdtc_ros.configuration.parameters import MOST_CLASSES
from phd_jdtc_ros.configuration.schema import SMALL, parameter, table


@dataclass(frozen=True)
class Evaluator:
    """What the evaluator is told."""

    tracker: str = parameter(names.TRACKER, "Full name of the tracker node.")
    world_frame: str = parameter("map", "Frame of the truth and of the estimates.")
    classes: list[str] = parameter(
        ["class_0", "class_1"], "Names of the target classes.", element=str, most=MOST_CLASSES
    )
    cutoff: float = parameter(1000.0, "OSPA's c, m.", SMALL)
    least_speed: float = parameter(
        0.0,
        "Slower targets are not scored, nor the estimates of them, m/s: those that the tracker "
        "takes for clutter, see clutter_map_speed.",
        0.0,
        1e3,
    )
    order: float = parameter(2.0, "OSPA's p.", 1.0, 100.0)
    report: str = parameter("", "Path of the final report (JSON); none if empty.")
    record: str = parameter("", "Directory of a bag of everything published; none if empty.")
    record_topics: list[str] = parameter(
        [names.detections("radar_1"), names.detections("radar_2")],
        "Topics to record too: clouds of detections, or poses of what carries radars with odometry "
        "or pose_stamped after the topic.",
        element=str,
    )
    exit_after_scans: int = parameter(
        0,
        "End once this many stamps are smoothed and scored; where the estimates come in a time of "
        "their own, once the truth has this many and they are. 0 never.",
        0,
        10**9,
    )


TABLE = table(Evaluator)
