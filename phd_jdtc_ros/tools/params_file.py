# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS parameter files and ``name:=value`` arguments, for the executables that are not nodes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from phd_jdtc_ros.core.configuration.schema import ConfigError, flatten

_NODE = "tracker"
# Regular expressions for the wildcards in a section's name, with the preceding slash.
_WILDCARDS = {"**": "(/[^/]+)*", "*": "/[^/]+"}


def load_yaml(path: Path) -> Any:
    """Return a YAML document.

    Raises
    ------
    ConfigError
        If the file cannot be read or is not YAML.
    """
    try:
        return yaml.safe_load(path.read_text())
    except OSError as error:
        raise ConfigError([f"{path}: cannot be read: {error.strerror}"]) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise ConfigError([f"{path}: is not YAML: {reason}"]) from error


def load(path: Path) -> dict[str, Any]:
    """Return the tracker's parameters in a ROS parameter file, by dotted name.

    As in ROS, a section is for all nodes whose name it matches (``*`` matches one part of a name,
    ``**`` any number of parts), and a later value overrides an earlier one. The tracker may be in
    any namespace.

    Raises
    ------
    ConfigError
        If it is not such a file, or has sections for trackers in several namespaces.
    """
    sections = list(_sections(load_yaml(path)))
    trackers = {name for name, _ in sections if name.endswith(f"/{_NODE}") and "*" not in name}
    if len(trackers) > 1:
        listed = ", ".join(sorted(trackers))
        raise ConfigError([f"{path}: has sections of several trackers, {listed}: must be one"])
    found: dict[str, Any] = {}
    for name, given in sections:
        if _is_for(name, next(iter(trackers), None)):
            found.update(flatten(given))
    if not found:
        raise ConfigError(
            [f"{path}: has no ros__parameters under {_NODE}, /NAMESPACE/{_NODE} or /**"]
        )
    return found


def _sections(document: Any, prefix: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the full name and the parameters of every section; namespaces may be nested."""
    for key, value in document.items() if isinstance(document, Mapping) else ():
        name = f"{prefix}/{str(key).strip('/')}"
        given = value.get("ros__parameters") if isinstance(value, Mapping) else None
        if isinstance(given, Mapping):
            yield name, given
        else:
            yield from _sections(value, name)


def _is_for(section: str, tracker: str | None) -> bool:
    """Return whether a section matches the tracker's full name, or any tracker if it is None."""
    parts = section.split("/")[1:]
    if tracker is None:
        return parts[-1] in (_NODE, *_WILDCARDS)
    pattern = "".join(_WILDCARDS.get(part, "/" + re.escape(part)) for part in parts)
    return re.fullmatch(pattern, tracker) is not None


def scenario_parameters(document: Any) -> dict[str, Any]:
    """Return the parameters in a scenario document, by dotted name.

    Parameters
    ----------
    document : mapping
        Its ``parameters``, nested or dotted, are those of the radars and the tracker that differ
        from the defaults; none if the key is absent.

    Raises
    ------
    ConfigError
        If they are not a mapping.
    """
    given = document.get("parameters", {}) if isinstance(document, Mapping) else {}
    if not isinstance(given, Mapping):
        raise ConfigError(["parameters: must be a mapping"])
    return dict(flatten(given))


def from_arguments(paths: Sequence[Path], assignments: Sequence[str]) -> dict[str, Any]:
    """Return parameters from files and ``name:=value`` assignments; later values override."""
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
            faults.append(f"-p {assignment}: is not YAML: {' '.join(str(error).split())}")
    if faults:
        raise ConfigError(faults)
    return found
