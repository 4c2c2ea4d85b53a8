"""A hook of mkdocs: a page for every package, with its docstring and a table of its modules.

The navigation lists the pages in ``code``. Those that are not files are made here: one for each
package, with its sub-packages that have no page of their own. The sources are parsed, not imported.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
INDEX = "code/index.md"
# The name of a package at the start of a row of the list of all packages.
NAME = re.compile(r"^\| ([\w: ]+) \|", re.MULTILINE)
# The text below an underlined heading is for readers of the code.
FIRST_SECTION = re.compile(r"^\w+\n-+$", re.MULTILINE)


def on_files(files: Any, config: Any) -> Any:
    """Return the pages of the site, with those of the packages."""
    # Tests import this module where mkdocs is not installed.
    from mkdocs.structure.files import File

    for path, folders in described(config.nav).items():
        content = "\n".join(_section(folder, folders[0], path) for folder in folders)
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, **_: Any) -> str:
    """Return a page; in the list of all packages each name becomes a link."""
    if page.file.src_uri != INDEX:
        return markdown
    link = {_title(path): path.removeprefix("code/") for path in described(config.nav)}
    return NAME.sub(
        lambda row: f"| [{row[1]}]({link[row[1]]}) |" if row[1] in link else row[0], markdown
    )


def described(nav: Any) -> dict[str, list[Path]]:
    """Return the folders on each page: a package, and its parts that have no page of their own."""
    own = {path: _folder(path) for path in _paths(nav) if path != INDEX}
    return {
        path: [
            part.parent
            for part in sorted(folder.rglob("__init__.py"))
            if not any(part.is_relative_to(each) for each in own.values() if folder in each.parents)
        ]
        for path, folder in own.items()
    }


def _paths(nav: Any) -> Iterator[str]:
    if isinstance(nav, str):
        yield from [nav] if nav.startswith("code/") else []
    else:
        for entry in nav.values() if isinstance(nav, dict) else nav:
            yield from _paths(entry)


def _parts(path: str) -> list[str]:
    return path.removeprefix("code/").removesuffix(".md").removesuffix("/index").split("/")


def _title(path: str) -> str:
    return ": ".join(_parts(path))


def _folder(path: str) -> Path:
    installed = ROOT.joinpath("phd_jdtc_ros", *_parts(path))
    return installed if installed.is_dir() else ROOT.joinpath(*_parts(path))


def _section(folder: Path, package: Path, path: str) -> str:
    below = folder.relative_to(package).as_posix()
    heading = f"# {_title(path)}" if folder == package else f"## {below}"
    return f"{heading}\n\n{_text(folder)}"


def _text(folder: Path) -> str:
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
