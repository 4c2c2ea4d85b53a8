"""The parameters of the evaluator node."""

from __future__ import annotations

from dataclasses import dataclass

from msg_adapters.encoding import names
from phd_jdtc_ros.configuration.parameters.tracker import MOST_CLASSES
from phd_jdtc_ros.configuration.schema import POSITIVE, parameter, table


@dataclass(frozen=True)
class Evaluator:
    """The parameters of the evaluator."""

    tracker: str = parameter(names.TRACKER, "Full name of the tracker node.")
    classes: list[str] = parameter(
        ["class_0", "class_1"], "Names of the target classes.", element=str, most=MOST_CLASSES
    )
    cutoff: float = parameter(1000.0, "Cut-off c of OSPA and GOSPA, m.", POSITIVE)
    least_speed: float = parameter(
        0.0,
        "Speed below which targets and the estimates of them are not scored, m/s. Set it to the "
        "tracker's clutter_map_speed.",
        (0.0, 1e3),
    )
    order: float = parameter(2.0, "Order p of OSPA and GOSPA.", (1.0, 100.0))
    report: str = parameter("", "Path of the final report (JSON); empty for none.")
    record: str = parameter("", "Directory of a bag of everything published; empty for none.")
    record_topics: list[str] = parameter(
        [names.detections("radar_1"), names.detections("radar_2")],
        "Further topics to record: clouds of detections, or platforms' poses with odometry, "
        "pose_stamped or tf after the topic.",
        element=str,
    )
    exit_after_scans: int = parameter(
        0,
        "Number of scored stamps after which the node ends; 0 for never. With estimates_period_s "
        "it is a number of stamps of the truth.",
        (0, 10**9),
    )


TABLE = table(Evaluator)
