"""ROS parameter files and ``name:=value`` arguments, for the executables that are not nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from phd_jdtc_ros.configuration.schema import ConfigError, flatten, read_each
from phd_jdtc_ros.parameter_files import sections, yaml_files
from phd_jdtc_ros.simulation import scenario_file

_NODE = "tracker"


def load(path: Path, node: str = _NODE) -> dict[str, Any]:
    """Return a node's parameters in a ROS parameter file, by dotted name; later values override.

    `node` is a name without a namespace: the node may be in any.

    Raise `ConfigError` if it is not such a file, or has sections for such nodes in several
    namespaces.
    """
    file = sections.read(path)
    names = [name for name, _ in file.sections]
    nodes = {name for name in names if name.endswith(f"/{node}") and "*" not in name}
    if len(nodes) > 1:
        listed = ", ".join(sorted(nodes))
        raise ConfigError(f"{path}: has sections of several {node}s, {listed}: must be one")
    if nodes:
        return file.values(nodes.pop())
    found: dict[str, Any] = {}
    for name, given in file.sections:
        if name.rpartition("/")[2] in (node, "*", "**"):
            found |= given
    if not found:
        raise ConfigError(f"{path}: has no ros__parameters under {node}, /NAMESPACE/{node} or /**")
    return found


def scenario_parameters(document: Any) -> dict[str, Any]:
    """Return the ``parameters`` and the radars' ``sites`` of a scenario, by dotted name.

    Raise `ConfigError` if they are not a mapping, or a site is wrong.
    """
    if not isinstance(document, Mapping):
        return {}
    given = document.get("parameters", {})
    if not isinstance(given, Mapping):
        raise ConfigError("parameters: must be a mapping")
    return scenario_file.site_parameters(document) | dict(flatten(given))


def from_arguments(
    paths: Sequence[Path], assignments: Sequence[str], node: str = _NODE
) -> dict[str, Any]:
    """Return a node's parameters from files and assignments; later values override."""

    def assign(assignment: str) -> dict[str, Any]:
        name, separator, value = assignment.partition(":=")
        if not value:
            hint = yaml_files.EMPTY_STRING if separator else ""
            raise ConfigError(f"-p {assignment}: must be NAME:=VALUE{hint}")
        return {name: yaml_files.parse(value, f"-p {yaml_files.one_line(assignment)}")}

    sources = [*(partial(load, path, node) for path in paths)]
    sources += [partial(assign, assignment) for assignment in assignments]
    parts = read_each(lambda source: source(), sources)
    return {name: value for part in parts for name, value in part.items()}
