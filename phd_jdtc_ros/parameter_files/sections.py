"""Sections of ROS parameter files, and their match with a node's name.

rclpy merges files silently: a node for which no file has a section runs with its defaults.
Therefore the files of a node's command line are read here too.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phd_jdtc_ros import resources
from phd_jdtc_ros.configuration.schema import ConfigError, flatten, read_each
from phd_jdtc_ros.parameter_files import yaml_files

# Name of the file with a tracker's parameters in a bag's directory.
BAG_PARAMETERS = "parameters.yaml"
# Regular expressions for the wildcards of a section's name, with the preceding slash.
_WILDCARDS = {"**": "(/[^/]+)*", "*": "/[^/]+"}


@dataclass(frozen=True)
class ParameterFile:
    """A parameter file."""

    path: Path
    # Full name, which may have wildcards, and parameters by dotted name, in the file's order.
    sections: tuple[tuple[str, dict[str, Any]], ...]

    def values(self, node: str) -> dict[str, Any]:
        """Return the parameters of a node, by its full name; later sections override earlier ones.

        Raise `ConfigError` if no section is for the node.
        """
        matching = [given for section, given in self.sections if is_for(section, node)]
        if not matching:
            names = yaml_files.one_line(", ".join(dict.fromkeys(dict(self.sections)))) or "none"
            raise ConfigError(f"{self.path}: has no section for this node, {node}; it has {names}")
        return {name: value for given in matching for name, value in given.items()}


def is_for(section: str, node: str) -> bool:
    """Return whether a section is for a node: ``*`` matches one part, ``**`` any number."""
    parts = section.split("/")[1:]
    pattern = "".join(_WILDCARDS.get(part, "/" + re.escape(part)) for part in parts)
    return re.fullmatch(pattern, node) is not None


def read(path: Path) -> ParameterFile:
    """Return a parameter file; `ConfigError` if it is unreadable or repeats a parameter."""
    found, faults = [], []
    document = yaml_files.load(path)
    if isinstance(document, Mapping) and isinstance(document.get("targets"), Sequence):
        shipped = resources.find(Path("bags", path.stem, BAG_PARAMETERS))
        instead = shipped if shipped.is_file() else f"the {BAG_PARAMETERS} that simulate writes"
        raise ConfigError(
            f"{path}: is a scenario file, must be a parameter file: give {instead}; offline tools "
            "take the scenario as --scenario"
        )
    for name, given in _sections(document):
        leaves = list(flatten(given))
        faults += [
            f"{path}: {name}: {leaf} is given twice"
            for leaf, count in Counter(leaf for leaf, _ in leaves).items()
            if count > 1
        ]
        found.append((name, dict(leaves)))
    if faults:
        raise ConfigError(*faults)
    return ParameterFile(path, tuple(found))


def given_in(argv: Sequence[str]) -> tuple[ParameterFile, ...]:
    """Return the parameter files among ROS arguments; `ConfigError` has the faults of all."""

    def of_nodes(path: Path) -> ParameterFile:
        file = read(path)
        # The error of rclpy would give only a line number.
        if not file.sections:
            raise ConfigError(f"{path}: has no ros__parameters under a node's name")
        return file

    return tuple(read_each(of_nodes, _paths(argv)))


def _paths(argv: Sequence[str]) -> Iterator[Path]:
    of_ros = False
    words = iter(argv)
    for word in words:
        if word in ("--ros-args", "--"):
            of_ros = word == "--ros-args"
        elif of_ros and word == "--params-file" and (path := next(words, None)) is not None:
            yield Path(path)


def _sections(document: Any, prefix: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the full name and the parameters of every section; namespaces may be nested."""
    for key, value in document.items() if isinstance(document, Mapping) else ():
        name = f"{prefix}/{str(key).strip('/')}"
        given = value.get("ros__parameters") if isinstance(value, Mapping) else None
        if isinstance(given, Mapping):
            yield name, given
        else:
            yield from _sections(value, name)
