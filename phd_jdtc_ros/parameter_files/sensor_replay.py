"""The replay's parameters, and the command-line flags that set some of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from msg_adapters import names
from phd_jdtc_ros.configuration.schema import ConfigError, parameter, table
from phd_jdtc_ros.exit_status import ArgumentParser

_PURPOSE = (
    "Plays a bag's detections, truth and other topics, at a rate or in lock-step with a tracker."
)
SLOWEST_RATE = 0.1


@dataclass(frozen=True)
class Replay:
    """What the replay is told at the start."""

    bag: str = parameter(
        "", "Path of the bag: a rosbag2 directory or an MCAP file; or the name of a shipped bag."
    )
    rate: float = parameter(
        1.0,
        "Speed relative to the recording, at least 0.1; 0 is lock-step: a scan is published once "
        "the estimate of the previous scan has come back.",
        0.0,
        1000.0,
    )
    loop: bool = parameter(False, "Start again at the end.")
    start_s: float = parameter(0.0, "Length of the bag's beginning to skip, s.", 0.0)
    duration_s: float = parameter(0.0, "Length of the part to play, s; 0 for all.", 0.0)
    start_paused: bool = parameter(False, "Start paused and wait for ~/resume or ~/step.")
    topics: list[str] = parameter(
        [],
        "Topics to play; empty for all but /clock, /diagnostics, /rosout, /parameter_events and "
        "those under /tracker and /evaluator.",
        element=str,
    )
    subscribers: int = parameter(
        1,
        "Number of subscribers of each topic of detections or of truth to wait for. As many as "
        "there will be, no one misses the beginning.",
        1,
        100,
    )
    subscriber_timeout_s: float = parameter(
        5.0, "Longest wait for subscribers of the detections, s.", 0.0, 3600.0
    )
    truth_timeout_s: float = parameter(
        1.0,
        "Longest further wait for subscribers of the truth, which a tracker does not need, s.",
        0.0,
        3600.0,
    )
    estimates_topic: str = parameter(
        names.estimates("filtered"), "Topic of the estimates that lock-step waits for."
    )
    answer_delay_s: float = parameter(
        0.0,
        "For a tracker of turning radars, whose scans have stamps of their own, s: lock-step waits "
        "for the figures of a scan that is at most this much older than the cloud.",
        0.0,
        1e3,
    )
    flush_service: str = parameter("", "Service called at the end, such as /tracker/flush.")


@dataclass(frozen=True)
class Seek:
    """What may be set while it runs."""

    seek_s: float = parameter(
        0.0,
        "Set while it runs, not before: go on from here, s from the bag's start; refused outside "
        "the part that is played.",
        0.0,
    )


AT_THE_START = table(Replay)
(SEEK,) = table(Seek)
TABLE = (*AT_THE_START, SEEK)


def check(values: Mapping[str, Any]) -> None:
    """Check what the table cannot express.

    Raises
    ------
    ConfigError
        With every fault.
    """
    faults = []
    if not values["bag"]:
        faults.append("bag: '' given, must be the path of a bag or the name of a shipped one")
    faults += _rate_faults(values["rate"])
    if faults:
        raise ConfigError(faults)


def rate(given: Any) -> float:
    """Return a rate that is given to something that starts the replay.

    Raises
    ------
    ConfigError
        If it is not allowed.
    """
    (own,) = (entry for entry in AT_THE_START if entry.name == "rate")
    value = own.coerce(given)
    if not isinstance(value, float):
        raise ConfigError([f"rate: {given!r} given, must be {own.allowed}"])
    if faults := _rate_faults(value):
        raise ConfigError(faults)
    return value


def _rate_faults(value: float) -> list[str]:
    if 0.0 < value < SLOWEST_RATE:
        return [f"rate: {value:g} given, must be 0 or at least {SLOWEST_RATE:g}"]
    return []


def flags(argv: Sequence[str]) -> dict[str, Any]:
    """Return the parameters that are set by plain command-line flags, without ROS arguments."""
    parser = ArgumentParser("sensor_replay", description=_PURPOSE)
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
