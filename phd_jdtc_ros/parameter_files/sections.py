"""Sections of ROS parameter files, and their match with a node's name.

rclpy merges files silently: a node for which no file has a section runs with its defaults, also if
a section for all nodes sets the clock. Therefore the files of a node's command line are read here
too. Some of them may be for other nodes, but one must be for this node.
"""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.schema import ConfigError, flatten, read_each
from phd_jdtc_ros.parameter_files import yaml_files

# Name of the file with a tracker's parameters in a bag's directory.
BAG_PARAMETERS = "parameters.yaml"

_KEY = "ros__parameters"
# Full names, which may have wildcards, and parameters by dotted name, in the file's order.
Sections: TypeAlias = "tuple[tuple[str, dict[str, Any]], ...]"


@dataclass(frozen=True)
class ParameterFile:
    """A parameter file as nodes read it: sections of parameters by name of the node."""

    # Beginning of the paths of the files that launch writes.
    _OF_LAUNCH = f"{tempfile.gettempdir()}/launch_params_"

    path: Path
    sections: Sections  # At least one

    @property
    def is_of_launch(self) -> bool:
        """Whether it has the parameters that are values in a launch file."""
        return str(self.path).startswith(self._OF_LAUNCH)

    def sections_for(self, node: str) -> Sections:
        """Return the sections for a node, by its full name."""
        return tuple(each for each in self.sections if is_for(each[0], node))

    def values(self, node: str) -> dict[str, Any]:
        """Return a node's own parameters, by its full name; `ConfigError` if it is for others."""
        found = self.sections_for(node)
        require_one(node, [self], [found])
        return own_values(found)


def own_values(sections: Sections) -> dict[str, Any]:
    """Return the parameters in the sections for a node; later sections override earlier ones.

    Those that rclpy gives every node are left out.
    """
    return {name: value for _, given in sections for name, value in given.items() if is_own(name)}


def is_own(parameter: str) -> bool:
    """Return whether a parameter is not one that rclpy gives every node."""
    # Parameters that rclpy gives every node: a section that has only these configures no node.
    of_every_node = ("use_sim_time", "start_type_description_service")
    return parameter not in of_every_node and not parameter.startswith("qos_overrides.")


def require_one(node: str, files: Sequence[ParameterFile], found: Sequence[Sections]) -> list[str]:
    """Return a line for each file that is only for other nodes than the named one.

    `found` has the sections of each file that are for the node. A file is for it if one of them has
    a parameter of its own, or the node's name and not a wildcard in its place.

    Raise `ConfigError` with those lines if no file of the user is for the node.
    """
    is_meant = [bool(own_values(own)) or any(name[-1] != "*" for name, _ in own) for own in found]
    others = [
        f"{file.path}: has no section for this node, {node}; it has {_listed(file, own)}"
        for file, own, meant in zip(files, found, is_meant, strict=True)
        if not meant and len(own) < len(file.sections)
    ]
    usable = (m and not file.is_of_launch for file, m in zip(files, is_meant, strict=True))
    if others and not any(usable):
        raise ConfigError(*others)
    return others


def _listed(file: ParameterFile, own: Sections) -> str:
    """Return the sections of a file, with the parameters of those that are for all nodes."""
    names = dict.fromkeys(name for name, _ in file.sections)
    only = {name: f" (only {', '.join(given)})" for name, given in own if given}
    return yaml_files.one_line(", ".join(name + only.get(name, "") for name in names))


def is_for(section: str, node: str) -> bool:
    """Return whether a section is for a node: ``*`` matches one part, ``**`` any number."""
    # Regular expressions for the wildcards of a section's name, with the preceding slash.
    wildcards = {"**": "(/[^/]+)*", "*": "/[^/]+"}
    parts = section.split("/")[1:]
    pattern = "".join(wildcards.get(part, "/" + re.escape(part)) for part in parts)
    return re.fullmatch(pattern, node) is not None


def read(path: Path) -> ParameterFile:
    """Return a parameter file; `ConfigError` if it has no section, or has a fault."""
    found, faults, astray = [], [], list[str]()
    document = yaml_files.load(path)
    if isinstance(document, Mapping) and isinstance(document.get("targets"), Sequence):
        shipped = resources.find(Path("bags", path.stem, BAG_PARAMETERS))
        instead = shipped if shipped.is_file() else f"the {BAG_PARAMETERS} that simulate writes"
        raise ConfigError(
            f"{path}: is a scenario file, must be a parameter file: give {instead}; offline tools "
            "take the scenario as --scenario"
        )
    for name, given in _sections(document):
        if given is None:
            astray.append(f"{path}: {name}: must be under {_KEY} of a node's name")
            continue
        leaves = list(flatten(given))
        faults += [
            f"{path}: {name}: {leaf} is given twice"
            for leaf, count in Counter(leaf for leaf, _ in leaves).items()
            if count > 1
        ]
        found.append((name, dict(leaves)))
    # The error of rclpy would give only a line number, and none for a file without sections.
    if not found:
        raise ConfigError(f"{path}: has no {_KEY} under a node's name")
    if faults or astray:
        raise ConfigError(*faults, *astray[:1])
    return ParameterFile(path, tuple(found))


def given_in(argv: Sequence[str]) -> tuple[ParameterFile, ...]:
    """Return the parameter files among ROS arguments; `ConfigError` has the faults of all."""
    return tuple(read_each(read, _paths(argv)))


def _paths(argv: Sequence[str]) -> Iterator[Path]:
    of_ros = False
    words = iter(argv)
    for word in words:
        if word in ("--ros-args", "--"):
            of_ros = word == "--ros-args"
        elif of_ros and word == "--params-file" and (path := next(words, None)) is not None:
            yield Path(path)


def _sections(document: Any, name: str = "") -> Iterator[tuple[str, Mapping[str, Any] | None]]:
    """Yield the full name and the parameters of every section; namespaces may be nested.

    A value that is in no section is yielded too, with None.
    """
    if not isinstance(document, Mapping):
        yield name, None
        return
    for key, value in document.items():
        if key == _KEY and name and isinstance(value, Mapping):
            yield name, value
        else:
            yield from _sections(value, f"{name}/{str(key).strip('/')}")
