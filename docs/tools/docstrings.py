"""A hook of mkdocs: a line ``::: PACKAGE`` becomes the package's docstring and a table of modules.

The sources are parsed, not imported.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
LINE = re.compile(r"^::: ([\w.]+)$", re.MULTILINE)
# The text below an underlined heading is for who reads the code.
FIRST_SECTION = re.compile(r"^\w+\n-+$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Return a page with its packages described."""
    return LINE.sub(lambda found: _described(found[1]), markdown)


def _described(package: str) -> str:
    folder = ROOT.joinpath(*package.split("."))
    text = FIRST_SECTION.split(_docstring(folder / "__init__.py"))[0]
    rows = [f"| `{path.name}` | {_summary(path)} |" for path in _modules(folder)]
    table = ["| module | does |", "|---|---|", *rows] if rows else []
    return "\n".join([_markdown(text), "", *table, ""])


def _docstring(path: Path) -> str:
    return ast.get_docstring(ast.parse(path.read_text())) or ""


def _summary(path: Path) -> str:
    """Return the first line of a module's docstring, fit for a table."""
    first = _docstring(path).partition("\n\n")[0].replace("\n", " ")
    return _markdown(first).replace("|", r"\|")


def _modules(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.glob("*.py")) if not path.name.startswith("_")]


def _markdown(text: str) -> str:
    """Return reStructuredText as docstrings use it, literal blocks and literals, as Markdown."""
    return re.sub(r"(?m)^::$|(?<=:):$", "", text).replace("``", "`")
