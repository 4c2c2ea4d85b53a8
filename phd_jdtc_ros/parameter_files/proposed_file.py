"""A parameter file with a comment beside every value that a recording has told."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from phd_jdtc_ros import output_files
from phd_jdtc_ros.configuration.parameters import schema
from phd_jdtc_ros.configuration.schema import flatten
from phd_jdtc_ros.parameter_files import bag_parameters

# Column in which comments begin where lines are shorter.
COLUMN = 44


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters by dotted name as nested mappings, in the order of the tables."""
    given = dict(flatten(values))
    order = [name for name in schema(given) if name in given]
    order += [name for name in given if name not in order]
    tree: dict[str, Any] = {}
    for name in sorted(order, key=lambda name: ("." in name, order.index(name))):
        place = tree
        *parents, last = name.split(".")
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = given[name]
    return tree


def lines(head: str, values: Mapping[str, Any], comments: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of a parameter file.

    Parameters
    ----------
    head : str
        Comment at the top.
    values : mapping of dotted name to value
    comments : mapping of dotted name to str
        Of parameters, and of sections (a radar's name).
    """
    yield from (f"# {line}".rstrip() for line in head.splitlines())
    yield f"{bag_parameters.ANY_TRACKER}:"
    yield "  ros__parameters:"
    yield from _block(nested(values), comments, "", 4)


def _block(
    tree: Mapping[str, Any], comments: Mapping[str, str], prefix: str, indent: int
) -> Iterator[str]:
    for key, value in tree.items():
        name, text = f"{prefix}{key}", " " * indent + f"{key}:"
        if not isinstance(value, Mapping):
            text += f" {bag_parameters.scalar(value)}"
        comment = comments.get(name)
        yield f"{text:{COLUMN}} # {comment}" if comment else text
        if isinstance(value, Mapping):
            yield from _block(value, comments, f"{name}.", indent + 2)


def write(path: Path, head: str, values: Mapping[str, Any], comments: Mapping[str, str]) -> None:
    """Write a parameter file; see `lines`."""
    output_files.write(path, "\n".join(lines(head, values, comments)) + "\n")
