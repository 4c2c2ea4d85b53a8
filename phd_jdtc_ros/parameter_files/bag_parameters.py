"""The parameter file beside a recording: its radars, classes and birth places.

It is in the bag's directory, and a live tracker can use it as its parameter file.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phd_jdtc_ros import output_files
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.configuration.tables import GROUPS, schema

from . import sections, yaml_files

NAME = sections.BAG_PARAMETERS


def path_of(bag: Path) -> Path:
    """Return the path of a bag's parameters, whether or not it has any."""
    return (bag if bag.is_dir() else bag.parent) / NAME


def read(bag: Path) -> dict[str, Any] | None:
    """Return the parameters beside a bag by dotted name, not checked; None if there are none.

    Raise `ConfigError` if the file cannot be read, or has no section for a tracker.
    """
    path = path_of(bag)
    return sections.read(path).values("/tracker") if path.is_file() else None


def write(path: Path, values: Mapping[str, Any], section: str = yaml_files.ANY_TRACKER) -> None:
    """Write a parameter file of the values that are not the defaults, and of all lists of names.

    The values are those of a checked configuration; others are left out. The section is the
    tracker's full name, in which wildcards are allowed.

    Raise `BagError` if it cannot be written, or would replace a file that was not written here.
    """
    head = "The tracker's parameters for this recording; the other parameters have their defaults."
    kept = {
        name: values[name]
        for name, parameter in schema(values).items()
        if name in values and (name in GROUPS or values[name] != parameter.default)
    }
    try:
        output_files.require_replaceable(path, "recording's parameter file", f"# {head}".encode())
        yaml_files.write(path, head, kept, section=section)
    except OSError as error:
        raise BagError(f"{path}: cannot be written: {error.strerror}") from error
