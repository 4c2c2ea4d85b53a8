"""Writes parameter files: beside recordings, and with a comment behind each proposed value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from phd_jdtc_ros import output_files
from phd_jdtc_ros.configuration.schema import ConfigError, flatten
from phd_jdtc_ros.configuration.tables import schema

from . import yaml_files

# The section of the shipped profiles: a tracker in any namespace.
ANY_TRACKER = "/**/tracker"
# Column in which comments begin behind shorter lines.
COLUMN = 44
_NO_COMMENTS: Mapping[str, str] = MappingProxyType({})


class _Dumper(yaml.SafeDumper):
    """Writes plain YAML, with quotes for text that the package's loader would not read as text."""

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
    """Return a number, a text or a list on one line of YAML."""
    text = yaml.dump(value, Dumper=_Dumper, default_flow_style=True, width=10**6)
    return text.removesuffix("\n").removesuffix("\n...")


def _tree(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters by dotted name as nested mappings, in the order of the tables."""
    given = dict(flatten(values))
    order = [*(name for name in schema(given) if name in given), *given]
    tree: dict[str, Any] = {}
    for name in sorted(given, key=lambda name: ("." in name, order.index(name))):
        place = tree
        *parents, last = name.split(".")
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = given[name]
    return tree


def lines(
    head: str,
    values: Mapping[str, Any],
    comments: Mapping[str, str] = _NO_COMMENTS,
    section: str = ANY_TRACKER,
) -> Iterator[str]:
    """Yield the lines of a parameter file, with a comment at its head.

    Comments are of parameters, and of sections (a radar's name). The section is the tracker's full
    name, in which wildcards are allowed.
    """
    yield from (f"# {line}".rstrip() for line in head.splitlines())
    yield f"{scalar(section)}:"
    yield "  ros__parameters:"
    yield from _block(_tree(values), comments, "", 4)


def _block(
    tree: Mapping[str, Any], comments: Mapping[str, str], prefix: str, indent: int
) -> Iterator[str]:
    for key, value in tree.items():
        name, text = f"{prefix}{key}", " " * indent + f"{scalar(key)}:"
        if not isinstance(value, Mapping):
            text += f" {scalar(value)}"
        comment = comments.get(name)
        yield f"{text:{COLUMN}} # {comment}" if comment else text
        if isinstance(value, Mapping):
            yield from _block(value, comments, f"{name}.", indent + 2)


def write(
    path: Path,
    head: str,
    values: Mapping[str, Any],
    comments: Mapping[str, str] = _NO_COMMENTS,
    section: str = ANY_TRACKER,
) -> None:
    """Write a parameter file; see `lines`."""
    output_files.write(path, "\n".join(lines(head, values, comments, section)) + "\n")
