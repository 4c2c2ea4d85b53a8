"""Parameters for the executables that are not nodes: from files and ``name:=value`` arguments."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from phd_jdtc_ros import resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.schema import ConfigError, flatten, read_each
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import node_tables
from phd_jdtc_ros.simulation import scenario_file

from . import sections, yaml_files
from .sections import ParameterFile, Sections

_NODE = "tracker"
# The profile of the reference scenario.
REFERENCE = "reference"


def load(path: Path, node: str = _NODE) -> dict[str, Any]:
    """Return a node's parameters in a ROS parameter file, by dotted name; later values override.

    `node` is a name without a namespace: the node may be in any.

    Raise `ConfigError` if it is not such a file, is for other nodes, or has sections for such nodes
    in several namespaces.
    """
    return _load([path], node)[0]


def _load(paths: Sequence[Path], node: str) -> list[dict[str, Any]]:
    """Return what `load` does for each file, of which some may be for other nodes."""
    files = read_each(sections.read, paths)
    found = read_each(partial(_sections_for, node), files)
    for line in sections.require_one(f"{node} in any namespace", files, found):
        print(f"{line}; it is not used", file=sys.stderr)
    return [sections.own_values(each) for each in found]


def _sections_for(node: str, file: ParameterFile) -> Sections:
    names = [name for name, _ in file.sections]
    nodes = {name for name in names if name.endswith(f"/{node}") and "*" not in name}
    if len(nodes) > 1:
        listed = ", ".join(sorted(nodes))
        raise ConfigError(f"{file.path}: has sections of several {node}s, {listed}: must be one")
    if nodes:
        return file.sections_for(nodes.pop())
    wanted = (node, "*", "**")
    return tuple(each for each in file.sections if each[0].rpartition("/")[2] in wanted)


def profile(name: str) -> dict[str, Any]:
    """Return the tracker's parameters of a shipped profile by dotted name, such as ``reference``.

    Raise `ConfigError` if there is no such profile.
    """
    try:
        return load(resources.profile(name)[0])
    except BagError as error:
        raise ConfigError(f"profile: {error}") from error


def scenario_parameters(document: Any) -> dict[str, Any]:
    """Return the tracker's parameters of a scenario, by dotted name.

    They are those of the shipped ``profile`` that it names, the radars' ``sites`` and its own
    ``parameters``; later ones override. Without a document they are those of the reference
    scenario. Raise `ConfigError` if they are not a mapping, or a profile or a site is wrong.
    """
    if document is None:
        return profile(REFERENCE)
    if not isinstance(document, Mapping):
        return {}
    named, given = document.get("profile"), document.get("parameters", {})
    if not isinstance(given, Mapping):
        raise ConfigError("parameters: must be a mapping")
    if not isinstance(named, str | None):
        raise ConfigError("profile: must be the name of a shipped profile")
    of_profile = {} if named is None else profile(named)
    return of_profile | scenario_file.site_parameters(document) | dict(flatten(given))


def from_arguments(
    paths: Sequence[Path], assignments: Sequence[str], node: str = _NODE
) -> dict[str, Any]:
    """Return a node's own parameters from files and assignments; later values override.

    A line is printed for each file that is for other nodes; see `sections.require_one`.
    """

    def assign(assignment: str) -> dict[str, Any]:
        name, separator, value = assignment.partition(":=")
        if not value:
            hint = yaml_files.EMPTY_STRING if separator else ""
            raise ConfigError(f"-p {assignment}: must be NAME:=VALUE{hint}")
        return {name: yaml_files.parse(value, f"-p {yaml_files.one_line(assignment)}")}

    # The faults of both are raised together.
    sources = (partial(_load, paths, node), partial(read_each, assign, assignments))
    parts: list[list[dict[str, Any]]] = read_each(lambda source: source(), sources)
    return {
        name: value
        for part in itertools.chain(*parts)
        for name, value in part.items()
        if sections.is_own(name)
    }


def config_of(given: Mapping[str, Any]) -> TrackerConfig:
    """Return the configuration by a live node's parameters; `ConfigError` has every fault."""
    return resolve(without_node(given), SystemPlane)


def without_node(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a live node's parameters without those that only a live node uses."""
    return {
        name: value
        for name, value in given.items()
        if name not in node_tables.NAMES and sections.is_own(name)
    }


def load_config(path: Path, tracker: str) -> TrackerConfig:
    """Return a tracker's configuration by a parameter file; `ConfigError` has every fault."""
    return config_of(sections.read(path).values(tracker))
