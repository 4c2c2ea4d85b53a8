"""The loader of all YAML that the package reads, and the writer of parameter files.

Scalars have the types of ROS (rcl_yaml_param_parser), which differ from YAML 1.1 in PyYAML:
``1e-6`` is a number, ``12:30`` is not. A repeated key is a fault. Size, depth and number of values
of a document are limited; an alias counts as many values as its anchor. Files are written beside
recordings, and with a comment behind each proposed value.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import yaml

from phd_jdtc_ros import output_files, quoting
from phd_jdtc_ros.configuration.schema import ConfigError, flatten
from phd_jdtc_ros.configuration.tables import schema

# Limits of a document, far above files written by hand; one at the limits takes less than 2 s.
LARGEST_BYTES = 2**19
DEEPEST = 32
MOST_VALUES = 20_000

# Hint in faults of assignments: a shell removes quotation marks, and :="" leaves nothing.
EMPTY_STRING = """; the value is missing: an empty string is -p "NAME:=''\""""

_PREFIX = "tag:yaml.org,2002:"
# A key is a name, even if it looks like a value: `y` and `1`.
_NOT_IN_KEYS = {_PREFIX + kind for kind in ("bool", "int", "float", "null")}
_NUMBERS = {
    "int": re.compile(r"[-+]?(?:0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)$"),
    "float": re.compile(
        r"[-+]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|\.?(?:inf|Inf|INF|nan|NaN|NAN))$"
    ),
}
_BOOLEANS = {
    word: value
    for value, words in ((True, ("y", "yes", "true", "on")), (False, ("n", "no", "false", "off")))
    for lower in words
    for word in (lower, lower.capitalize(), lower.upper())
}


class _RefusedError(yaml.YAMLError):
    """YAML that is not accepted, with the reason."""

    def __init__(self, mark: yaml.Mark, problem: str) -> None:
        super().__init__(problem)
        self.line = mark.line + 1


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader with the scalars of ROS and with limits."""

    yaml_constructors: ClassVar[dict[str | None, Any]] = {
        None: yaml.SafeLoader.yaml_constructors[None],
        **{
            _PREFIX + kind: yaml.SafeLoader.yaml_constructors[_PREFIX + kind]
            for kind in ("null", "seq", "map")
        },
        # Launch files write lists like this, and rcl does not look at the tag.
        _PREFIX + "python/tuple": yaml.SafeLoader.yaml_constructors[_PREFIX + "seq"],
    }

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0
        self._values = 0
        # Number of values of each anchor's node, once it is complete.
        self._sizes: dict[str, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        peek: Callable[[], Any] = self.peek_event
        event = peek()
        before, alias = self._values, isinstance(event, yaml.AliasEvent)
        if alias and event.anchor in self.anchors and event.anchor not in self._sizes:
            raise _RefusedError(event.start_mark, f"*{event.anchor} is a part of what it refers to")
        self._values += self._sizes.get(event.anchor, 1) if alias else 1
        self._depth += 1
        if self._values > MOST_VALUES:
            raise _RefusedError(event.start_mark, f"more than {MOST_VALUES} values")
        if self._depth > DEEPEST:
            raise _RefusedError(event.start_mark, f"nested more than {DEEPEST} levels deep")
        node = super().compose_node(parent, index)
        self._depth -= 1
        if event.anchor is not None and not alias:
            self._sizes[event.anchor] = self._values - before
        return node

    def compose_mapping_node(self, anchor: Any) -> Any:
        node = super().compose_mapping_node(anchor)
        first: dict[str, int] = {}
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue  # Such a key is refused when it is constructed
            if key.tag in _NOT_IN_KEYS:
                key.tag = _PREFIX + "str"
            if key.value in first:
                raise _RefusedError(
                    key.start_mark, f"{key.value} is given twice, first in line {first[key.value]}"
                )
            first[key.value] = key.start_mark.line + 1
        return node

    def construct_text(self, node: yaml.ScalarNode) -> str:
        text = str(node.value)
        if quoting.printable(text) != text:
            raise _RefusedError(node.start_mark, f"{text!r} has control characters")
        return text

    def construct_boolean(self, node: yaml.ScalarNode) -> bool:
        if node.value not in _BOOLEANS:
            raise _RefusedError(node.start_mark, f"{node.value!r} is not true or false")
        return _BOOLEANS[node.value]

    def construct_whole(self, node: yaml.ScalarNode) -> int:
        text = node.value
        if not _NUMBERS["int"].match(text):
            raise _RefusedError(node.start_mark, f"{text!r} is not a whole number")
        digits = text.lstrip("+-").lower()
        base = 16 if digits.startswith("0x") else 8 if digits.startswith("0") else 10
        # Python refuses to convert thousands of digits.
        value = int(text, base) if len(digits) < 64 else 2**64
        if not -(2**63) <= value < 2**63:
            raise _RefusedError(node.start_mark, f"{text} is not a number of 64 bits")
        return value

    def construct_real(self, node: yaml.ScalarNode) -> float:
        if not _NUMBERS["float"].match(node.value):
            raise _RefusedError(node.start_mark, f"{node.value!r} is not a number")
        named = node.value.lower().lstrip("+-.")
        return float(node.value.replace(".", "") if named in ("inf", "nan") else node.value)


# The types of ROS below replace those of YAML.
_Loader.yaml_implicit_resolvers = {}


_Loader.add_constructor(_PREFIX + "str", _Loader.construct_text)
# The order is the order of precedence.
for _kind, _pattern, _construct in (
    ("bool", re.compile(f"(?:{'|'.join(_BOOLEANS)})$"), _Loader.construct_boolean),
    ("int", _NUMBERS["int"], _Loader.construct_whole),
    ("float", _NUMBERS["float"], _Loader.construct_real),
):
    _Loader.add_implicit_resolver(_PREFIX + _kind, _pattern, None)
    _Loader.add_constructor(_PREFIX + _kind, _construct)
_Loader.add_implicit_resolver(_PREFIX + "null", re.compile(r"(?:~|null|Null|NULL|)$"), None)
_Loader.add_implicit_resolver(_PREFIX + "merge", re.compile(r"<<$"), None)


def parse(text: str, where: str) -> Any:
    """Return the document in a text; `where` is its name in faults.

    Raise `ConfigError` if it is not YAML, has a key twice, or is above a limit.
    """
    loader = _Loader("")
    try:
        loader = _Loader(text)
        return loader.get_single_data()
    except _RefusedError as error:
        raise ConfigError(f"{where}: line {error.line}: {one_line(error)}") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"{where}: is not YAML: {_place_and_problem(error)}") from error
    finally:
        loader.dispose()


def _place_and_problem(error: yaml.YAMLError) -> str:
    """Return the line of a fault and the words about it, without PyYAML's name of the text."""
    if not isinstance(error, yaml.MarkedYAMLError) or error.problem_mark is None:
        return one_line(error)
    mark = error.problem_mark
    words = ", ".join(filter(None, (error.context, error.problem)))
    return f"line {mark.line + 1}, column {mark.column + 1}: {one_line(words)}"


def load(path: Path) -> Any:
    """Return the document in a file; raise `ConfigError` as `parse`, or if it cannot be read."""
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) > LARGEST_BYTES:
        raise ConfigError(f"{path}: is larger than {LARGEST_BYTES} bytes")
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        line, byte = content.count(b"\n", 0, error.start) + 1, content[error.start]
        raise ConfigError(
            f"{path}: is not YAML: line {line}: byte 0x{byte:02x} is not UTF-8, as it must be"
        ) from error
    return parse(text, str(path))


def one_line(error: object) -> str:
    """Return a text as one line, shortened in its middle."""
    # Largest number of characters of YAML that a fault quotes.
    return quoting.short(" ".join(str(error).split()), 240)


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
        plain = parse(text, "") == text
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
