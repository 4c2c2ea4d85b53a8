"""The parameters of the evaluator node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from msg_adapters.encoding import names
from phd_jdtc_ros.configuration.parameters import replaced
from phd_jdtc_ros.configuration.parameters.place_forms import POSE_MESSAGES, TF
from phd_jdtc_ros.configuration.parameters.tracker import MOST_CLASSES
from phd_jdtc_ros.configuration.schema import POSITIVE, Form, parameter, table

# The word in `record_types` for a topic of detections.
CLOUD = "cloud"


def _topics(given: Any) -> list[str] | None:
    if isinstance(given, (str, bytes)) or not hasattr(given, "__len__"):
        return None
    sound = all(isinstance(topic, str) and len(topic.split()) == 1 for topic in given)
    return [*given] if sound and len(set(given)) == len(given) else None


TOPICS = Form("a list of distinct topics", _topics)


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
    report: str = parameter("", "Path of the final report (JSON); empty for none.")
    record: str = parameter("", "Directory of a bag of everything published; empty for none.")
    record_topics: list[str] = parameter(
        [names.detections("radar_1"), names.detections("radar_2")],
        "Further topics to record, of detections or platforms' poses.",
        form=TOPICS,
        former=replaced.record_topics,
    )
    record_types: list[str] = parameter(
        [],
        "Message of each of record_topics; empty if all are clouds.",
        element=str,
        choices=(CLOUD, *POSE_MESSAGES, TF),
        repeats=True,
    )
    exit_after_scans: int = parameter(
        0,
        "Number of scored stamps after which the node ends; 0 for never. With estimates_period_s "
        "it is a number of stamps of the truth.",
        (0, 10**9),
    )


TABLE = table(Evaluator)
