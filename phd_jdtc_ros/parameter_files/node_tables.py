"""The parameters of the evaluator and of the replay, and the flags that set some of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from msg_adapters.encoding import names
from phd_jdtc_ros.configuration.parameters import replaced
from phd_jdtc_ros.configuration.parameters.place_forms import POSE_MESSAGES, TF
from phd_jdtc_ros.configuration.parameters.tracker import MOST_CLASSES
from phd_jdtc_ros.configuration.schema import (
    NOT_NEGATIVE,
    POSITIVE,
    ConfigError,
    Form,
    number,
    parameter,
    table,
)
from phd_jdtc_ros.exit_status import ArgumentParser

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


EVALUATOR = table(Evaluator)


SLOWEST_RATE, FASTEST_RATE = 0.1, 1000.0


def _rate(value: Any) -> float | None:
    found = number(value, 0.0, FASTEST_RATE)
    return None if found is not None and 0.0 < found < SLOWEST_RATE else found


BAG = Form(
    "the path of a bag or the name of a shipped one",
    lambda value: value if isinstance(value, str) and value else None,
)
RATE = Form(f"0, or a number from {SLOWEST_RATE:g} to {FASTEST_RATE:g}", _rate)
# It has no bounds as a parameter, so that a whole number may be set too.
POSITION = Form("a finite number, at least 0", lambda value: number(value, 0.0))


@dataclass(frozen=True)
class Replay:
    """The parameters of the replay."""

    bag: str = parameter(
        "", "Path of a rosbag2 directory or an MCAP file, or a shipped bag's name.", form=BAG
    )
    rate: float = parameter(
        1.0,
        "Speed relative to the recording; 0 is lock-step, in which a scan is published once the "
        "estimate of the previous scan has been received.",
        form=RATE,
    )
    loop: bool = parameter(False, "Start again at the end.")
    start_s: float = parameter(
        0.0,
        "Where to begin, s from the bag's start; set during the replay, where to continue. It is "
        "then rejected outside the part that is played.",
        form=POSITION,
        mutable=True,
    )
    duration_s: float = parameter(0.0, "Length of the part to play, s; 0 for all.", NOT_NEGATIVE)
    start_paused: bool = parameter(False, "Start paused and wait for ~/resume or ~/step.")
    topics: list[str] = parameter(
        [],
        "Topics to play; empty for all but /clock, /diagnostics, /rosout, /parameter_events and "
        "those under /tracker and /evaluator.",
        element=str,
    )
    subscribers: int = parameter(
        1,
        "Number of subscribers to wait for on each topic of detections or truth, so that none of "
        "them misses the beginning.",
        (1, 100),
    )
    subscriber_timeout_s: float = parameter(
        5.0,
        "Longest wait for subscribers of the detections, s, and a fifth of it for those of the "
        "truth, which a tracker does not need.",
        (0.0, 3600.0),
    )
    answer_delay_s: float = parameter(
        0.0,
        "Largest age of the tracker's last scan relative to a published cloud, s, in lock-step "
        "with a tracker of turning radars, whose scans have stamps of their own.",
        (0.0, 1e3),
    )
    flush_service: str = parameter("", "Service called at the end, such as /tracker/flush.")


REPLAY = table(Replay)


def rate(text: str) -> float:
    """Return the rate given to a program that starts the replay, or raise `ConfigError`."""
    try:
        value = _rate(float(text))
    except ValueError:
        value = None
    if value is None:
        raise ConfigError(f"rate: {text!r} given, must be {RATE.allowed}")
    return value


def flags(argv: Sequence[str]) -> dict[str, Any]:
    """Return the parameters set by plain command-line flags, without ROS arguments."""
    parser = ArgumentParser(
        "sensor_replay",
        description="Plays a bag's detections, truth and other topics, at a rate or in lock-step "
        "with a tracker.",
    )
    parser.add_argument(
        "bag", nargs="?", help="rosbag2 directory, MCAP file, or the name of a shipped bag"
    )
    parser.add_argument("--rate", type=float, help="speed, 1 by default; 0 is lock-step")
    parser.add_argument("--start", type=float, dest="start_s", metavar="S", help="skip, s")
    parser.add_argument(
        "--duration", type=float, dest="duration_s", metavar="S", help="play this much, s"
    )
    parser.add_argument("--loop", action="store_true", default=None, help="begin again at the end")
    parser.add_argument(
        "--start-paused", action="store_true", default=None, help="wait for ~/resume or ~/step"
    )
    given = vars(parser.parse_args(argv))
    return {name: value for name, value in given.items() if value is not None}
