"""The tracker's parameters beside a recording: what its radars, classes and birth places are.

They are a ROS parameter file in the bag's directory, so that a live tracker takes it as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from phd_jdtc_ros import output_files
from phd_jdtc_ros.bags.errors import BagError
from phd_jdtc_ros.configuration.parameters import GROUPS, schema
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.parameter_files import yaml_files

from . import sections

NAME = sections.BAG_PARAMETERS
# The section, as in the shipped profiles: of the tracker in any namespace.
ANY_TRACKER = "/**/tracker"
_HEAD = """\
# The tracker's parameters for this recording; those that are not here have their defaults.
"""


class _Dumper(yaml.SafeDumper):
    """Writes YAML as people do, with quotes for text that the package's loader takes otherwise."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write every value in full."""
        return True


def _text(dumper: _Dumper, text: str) -> yaml.Node:
    try:
        plain = yaml_files.parse(text, "") == text
    except ConfigError:
        plain = False
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if plain else '"')


_Dumper.add_representer(str, _text)


def scalar(value: Any) -> str:
    """Return a number, a text or a list as it stands in a file, on one line."""
    text = yaml.dump(value, Dumper=_Dumper, default_flow_style=True, width=10**6)
    return text.removesuffix("\n").removesuffix("\n...")


def path_of(bag: Path) -> Path:
    """Return where the parameters of a bag are, if it has any."""
    return (bag if bag.is_dir() else bag.parent) / NAME


def read(bag: Path) -> dict[str, Any] | None:
    """Return the parameters beside a bag by dotted name, not checked; None if there are none.

    Raises
    ------
    ConfigError
        If the file cannot be read, or has no section for a tracker.
    """
    path = path_of(bag)
    return sections.read(path).values("/tracker") if path.is_file() else None


def write(path: Path, values: Mapping[str, Any], section: str = ANY_TRACKER) -> None:
    """Write a parameter file of the values that are not the defaults, and of all lists of names.

    Parameters
    ----------
    path : Path
    values : mapping of dotted name to value
        All parameters of a checked configuration; others are left out.
    section : str
        The tracker's full name; wildcards are allowed.

    Raises
    ------
    BagError
        If it cannot be written.
    """
    kept: dict[str, Any] = {}
    for name, parameter in schema(values).items():
        if name in values and (name in GROUPS or values[name] != parameter.default):
            _put(kept, name.split("."), values[name])
    document = {section: {"ros__parameters": kept}}
    text = yaml.dump(document, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100)
    try:
        output_files.write(path, _HEAD + text)
    except OSError as error:
        raise BagError(f"{path}: cannot be written: {error.strerror}") from error


def _put(tree: dict[str, Any], parts: list[str], value: Any) -> None:
    """Put a value into nested mappings."""
    *parents, last = parts
    for parent in parents:
        tree = tree.setdefault(parent, {})
    tree[last] = value
