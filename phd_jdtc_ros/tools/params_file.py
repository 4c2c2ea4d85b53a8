"""ROS parameter files and ``name:=value`` arguments, for the executables that are no nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from phd_jdtc_ros.core.config import ConfigError
from phd_jdtc_ros.core.parameters import flatten

# Sections of a parameter file that apply to the tracker.
_SECTIONS = ("/**", "/**/tracker", "tracker", "/tracker")


def load_yaml(path: Path) -> Any:
    """Return a YAML document.

    Raises
    ------
    ConfigError
        If the file cannot be read or is no YAML.
    """
    try:
        return yaml.safe_load(path.read_text())
    except OSError as error:
        raise ConfigError([f"{path}: cannot be read: {error.strerror}"]) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise ConfigError([f"{path}: is no YAML: {reason}"]) from error


def load(path: Path) -> dict[str, Any]:
    """Return the tracker's parameters in a ROS parameter file, by dotted name.

    Raises
    ------
    ConfigError
        If it is no such file.
    """
    document = load_yaml(path)
    sections = document if isinstance(document, Mapping) else {}
    found: dict[str, Any] = {}
    for name in _SECTIONS:
        section = sections.get(name)
        if isinstance(section, Mapping) and isinstance(section.get("ros__parameters"), Mapping):
            found.update(flatten(section["ros__parameters"]))
    if not found:
        raise ConfigError([f"{path}: has no ros__parameters under any of {', '.join(_SECTIONS)}"])
    return found


def scenario_parameters(document: Any) -> dict[str, Any]:
    """Return the parameters in a scenario document, by dotted name.

    Parameters
    ----------
    document : mapping
        Its ``parameters``, nested or dotted, say in what the radars and the tracker differ from
        their defaults; none where the key is absent.

    Raises
    ------
    ConfigError
        If they are no mapping.
    """
    given = document.get("parameters", {}) if isinstance(document, Mapping) else {}
    if not isinstance(given, Mapping):
        raise ConfigError(["parameters: must be a mapping"])
    return dict(flatten(given))


def from_arguments(paths: Sequence[Path], assignments: Sequence[str]) -> dict[str, Any]:
    """Return parameters from files and ``name:=value`` assignments; the last one wins."""
    found: dict[str, Any] = {}
    faults: list[str] = []
    for path in paths:
        try:
            found.update(load(path))
        except ConfigError as error:
            faults += error.faults
    for assignment in assignments:
        name, separator, value = assignment.partition(":=")
        if not separator:
            faults.append(f"-p {assignment}: must be NAME:=VALUE")
            continue
        try:
            found[name] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            faults.append(f"-p {assignment}: is no YAML: {' '.join(str(error).split())}")
    if faults:
        raise ConfigError(faults)
    return found
