"""The parameters of nodes besides the tracker's models, and the flags that set some of these."""

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


@dataclass(frozen=True)
class Managed:
    """The parameter of every managed node."""

    autostart: bool = parameter(True, "Configure and activate the node at the start.")


@dataclass(frozen=True)
class Receiving:
    """Common parameters of the nodes that receive from the network."""

    max_clock_offset_s: float = parameter(
        10.0,
        "Difference between the times of a source and those of receipt, s, above which its clock "
        "counts as wrong: the times of a radar are then shifted by the difference, and a report "
        "has the time of its receipt.",
        (0.5, 86400.0),
    )
    interface: str = parameter(
        "",
        "Address of the network interface for multicast groups, in and out; empty for the "
        "system's choice.",
    )
    replayed: bool = parameter(
        False,
        "Whether the input is a replayed recording, whose times of receipt are ignored: times are "
        "then those in it, and the first day of ASTERIX is 1970-01-01, as for a file.",
    )


@dataclass(frozen=True)
class Node(Managed):
    """The parameters of the live node only."""

    max_wait_s: float = parameter(
        0.0,
        "Longest time for which a scan waits for missing radars, s by the wall clock; 0 to wait "
        "for a later stamp.",
        (0.0, 3600.0),
    )
    outputs: list[str] = parameter(
        ["detections", "frames", "markers", "curves"],
        "Optional outputs; the tracker's page lists their topics, and the page of outputs what is "
        "sent by UDP and TCP. Latitudes and longitudes need world_origin, and only markers can "
        "change while the tracker is configured.",
        element=str,
        mutable=True,
        former=replaced.outputs,
    )
    destinations: list[str] = parameter(
        ["nmea+udp://127.0.0.1:10110", "cot+udp://127.0.0.1:4242", "signalk+udp://127.0.0.1:8375"],
        "Where ttm, ttm_relative and tll in outputs (nmea), cot, signalk and sapient are sent: "
        "FORMAT+udp:// or FORMAT+tcp:// with the HOST:PORT to send to, or FORMAT+listen:// with "
        "that at which TCP clients connect; sapient not by UDP.",
        element=str,
    )
    cot_types: list[str] = parameter(
        [],
        "Types of the classes in Cursor on Target, in their order, such as a-u-S for vessels. "
        "Empty for a-u-G, or a-u-A for a target with a code or an address.",
        element=str,
        repeats=True,
    )
    checkpoint_path: str = parameter(
        "",
        "File in which the tracker's state is stored, for a warm restart; empty for none.",
        name="checkpoint.path",
    )
    checkpoint_every: int = parameter(
        1,
        "Number of scans between checkpoints; 0 for checkpoints on request only.",
        (0, 10**6),
        name="checkpoint.every",
    )


NAMES = frozenset(parameter.name for parameter in table(Node))


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
        "Number of scored stamps after which the node ends; 0 for never. With estimates_period_s, "
        "or without estimates at some of them, it is a number of stamps of the truth.",
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
