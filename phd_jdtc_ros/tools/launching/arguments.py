"""The arguments of the launch files: values, names of nodes, and when a node is started again.

Nothing here imports launch, so that it can be tested without.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.exit_status import OK, USAGE
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, node_tables, sections

_BOOLEANS = {"true": True, "True": True, "1": True, "false": False, "False": False, "0": False}


def booleans(given: Mapping[str, str]) -> dict[str, bool]:
    """Return the values of Boolean launch arguments; `ConfigError` lists all that are not."""
    faults = [
        f"{name}: {text!r} given, must be one of {', '.join(_BOOLEANS)}"
        for name, text in given.items()
        if text not in _BOOLEANS
    ]
    if faults:
        raise ConfigError(*faults)
    return {name: _BOOLEANS[text] for name, text in given.items()}


def whole(name: str, text: str) -> int:
    """Return the value of a launch argument that must be a whole number, at least 0."""
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise ConfigError(f"{name}: {text!r} given, must be a whole number, at least 0")
    return int(text)


def full_namespace(pushed: str | None, given: str) -> str:
    """Return the full namespace of a node, ``/`` for the root.

    `pushed` is that of the group that includes the launch file (PushRosNamespace), to which `given`
    is relative unless it begins with a slash.
    """
    names = given.split("/") if given.startswith("/") else f"{pushed or ''}/{given}".split("/")
    return "/" + "/".join(filter(None, names))


def full_name(namespace: str, node: str) -> str:
    """Return the full name of a node in a full namespace."""
    return f"{namespace.rstrip('/')}/{node}"


def load(params_file: str, tracker: str) -> TrackerConfig:
    """Return the configuration in a file for the tracker of this full name, or the defaults.

    Raises `ConfigError` if the file has no section for the tracker, or with every fault.
    """
    return from_arguments.load_config(Path(params_file), tracker) if params_file else resolve({})


def outputs(params_file: str, tracker: str, frames: bool) -> list[str]:
    """Return the ``outputs`` in a file that `load` accepts, with or without the radars' frames."""
    given = sections.read(Path(params_file)).values(tracker) if params_file else {}
    others = given.get("outputs", node_tables.Node().outputs)
    return [*(name for name in others if name != "frames"), *(["frames"] if frames else [])]


def demo(bag: str, params_file: str, tracker: str, out: Path) -> tuple[Path, str, TrackerConfig]:
    """Return a demo's bag, the tracker's parameter file, empty for the defaults, and what it says.

    The bag is given by its path, or by its name if it is a shipped one. Unless a file is given, the
    parameters beside it are written into the directory `out`, for the tracker with this full name.
    `BagError` is raised if there is no such bag, and `ConfigError` with every fault of the
    parameters.
    """
    found = resources.bag(bag)
    recorded = None if params_file else bag_parameters.read(found)
    if recorded is None:
        return found, params_file, load(params_file, tracker)
    config = from_arguments.config_of(recorded)
    out.mkdir(parents=True, exist_ok=True)
    path = out / bag_parameters.NAME
    bag_parameters.write(path, config.values, section=tracker)
    return found, str(path), config


def is_final(status: int, ends: int, retries: int) -> bool:
    """Return whether a node that ended with `status`, for the `ends`-th time, stays ended."""
    return status == USAGE or (status != OK and ends > retries)
