"""Code that the launch files share and that needs no launch: arguments, names, when to respawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration import tracker_node
from phd_jdtc_ros.configuration.build import TrackerConfig
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import OK, USAGE
from phd_jdtc_ros.parameter_files import bag_parameters, sections, sensor_replay, tracker_params

_BOOLEANS = {"true": True, "True": True, "1": True, "false": False, "False": False, "0": False}


def booleans(given: Mapping[str, str]) -> dict[str, bool]:
    """Return the values of launch arguments that are true or false.

    Raises
    ------
    ConfigError
        With every argument that is neither.
    """
    faults = [
        f"{name}: {text!r} given, must be one of {', '.join(_BOOLEANS)}"
        for name, text in given.items()
        if text not in _BOOLEANS
    ]
    if faults:
        raise ConfigError(faults)
    return {name: _BOOLEANS[text] for name, text in given.items()}


def whole(name: str, text: str) -> int:
    """Return the value of a launch argument that is a whole number.

    Raises
    ------
    ConfigError
        If it is none, or negative.
    """
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise ConfigError([f"{name}: {text!r} given, must be a whole number, at least 0"])
    return int(text)


def rate(text: str) -> float:
    """Return the value of the launch argument that is the rate of a replay.

    Raises
    ------
    ConfigError
        If the replay would refuse it.
    """
    try:
        given: float | str = float(text)
    except ValueError:
        given = text
    return sensor_replay.rate(given)


def full_namespace(pushed: str | None, given: str) -> str:
    """Return the full namespace of a node, ``/`` for the root.

    Parameters
    ----------
    pushed : str or None
        That of the group that the launch file is in (PushRosNamespace).
    given : str
        Relative to it, unless it begins with a slash.
    """
    names = given.split("/") if given.startswith("/") else f"{pushed or ''}/{given}".split("/")
    return "/" + "/".join(filter(None, names))


def full_name(namespace: str, node: str) -> str:
    """Return the full name of a node in a full namespace."""
    return f"{namespace.rstrip('/')}/{node}"


def load(params_file: str, tracker: str) -> TrackerConfig:
    """Return the configuration of the tracker of that full name; without a file the defaults.

    Raises
    ------
    ConfigError
        If the file has no section for the tracker, or with every fault.
    """
    if not params_file:
        return tracker_params.config({})
    return tracker_params.load(Path(params_file), tracker)


def outputs(params_file: str, tracker: str, frames: bool) -> list[str]:
    """Return the tracker's ``outputs`` with or without the radars' frames, whatever its file says.

    The file is one that `load` takes.
    """
    given = sections.read(Path(params_file)).values(tracker) if params_file else {}
    others = given.get("outputs", tracker_node.Node().outputs)
    return [*(name for name in others if name != "frames"), *(["frames"] if frames else [])]


@dataclass(frozen=True)
class Demo:
    """What a demo plays, and to which tracker.

    Parameters
    ----------
    params_file : str
        Of the tracker; empty for its defaults.
    """

    bag: Path
    params_file: str
    config: TrackerConfig


def demo(bag: str, params_file: str, tracker: str, out: Path) -> Demo:
    """Return the demo of a bag, with the parameters beside it unless a file is given.

    Parameters
    ----------
    bag : str
        Path of a bag, or the name of a shipped one.
    params_file : str
        Of the tracker; empty if there is none.
    tracker : str
        Its full name.
    out : Path
        Directory for a parameter file with the tracker's name.

    Raises
    ------
    BagError
        If there is no bag of that name.
    ConfigError
        With every fault of the parameters.
    """
    found = resources.bag(bag)
    recorded = None if params_file else bag_parameters.read(found)
    if recorded is None:
        return Demo(found, params_file, load(params_file, tracker))
    config = tracker_params.config(recorded)
    out.mkdir(parents=True, exist_ok=True)
    path = out / bag_parameters.NAME
    bag_parameters.write(path, config.values, section=tracker)
    return Demo(found, str(path), config)


def is_final(status: int, ends: int, retries: int) -> bool:
    """Return whether a node that has failed is not to be started again.

    Parameters
    ----------
    status : int
        Its exit status.
    ends : int
        How often it has ended by now.
    retries : int
        How often it may be started again.
    """
    return status == USAGE or (status != OK and ends > retries)
