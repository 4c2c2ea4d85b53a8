"""A hook of mkdocs: tables that fit narrow columns.

Every cell is given its column's heading, which ``site.css`` shows beside the cell where a table is
too wide to be one, as on a phone. Long names may break after their separators; a number and its
unit stay on one line, and so do a mean and its interval.
"""

from __future__ import annotations

import html
import re
from itertools import count
from typing import Any

TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
HEADING = re.compile(r"<th\b[^>]*>(.*?)</th>", re.DOTALL)
ROW = re.compile(r"<tr>.*?</tr>", re.DOTALL)
LONG_CODE = re.compile(r"(?<=<code>)[^<]{20,}(?=</code>)")
TAG = re.compile(r"<[^>]+>")
# After these a name may go on in the next line.
SEPARATOR = re.compile(r"([/.,_]|:=)(?=\w)")
SPACE_IN_FIGURE = re.compile(r"(?<=\d) (?=(?:%|°|kt|k?m|m?s|NM|MB)(?!\w)|±)|(?<=±) (?=\d)")


def on_page_content(page_html: str, **_: Any) -> str:
    """Return a page with its tables prepared."""
    return TABLE.sub(lambda found: _prepared(found[0]), page_html)


def _prepared(table: str) -> str:
    headings = [TAG.sub("", heading).strip() for heading in HEADING.findall(table)]

    def labelled(row: re.Match[str]) -> str:
        column = count()
        return re.sub(
            r"<td\b", lambda _: f'<td data-label="{_attribute(headings[next(column)])}"', row[0]
        )

    table = ROW.sub(labelled, table)
    table = SPACE_IN_FIGURE.sub("\N{NO-BREAK SPACE}", table)
    return LONG_CODE.sub(lambda code: SEPARATOR.sub(r"\1<wbr>", code[0]), table)


def _attribute(heading: str) -> str:
    return html.escape(html.unescape(heading), quote=True)
