"""The figures as a table for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from .figures import Figure

REACHED = {True: "yes", False: "no", None: "-"}
STYLE = {True: None, False: "red", None: "dim"}


def table(title: str, figures: Sequence[Figure]) -> Table:
    """Return the table."""
    found = Table(title=title, show_lines=True)
    for heading in ("figure", "goal", "measured", "reached"):
        found.add_column(heading, overflow="fold")
    for figure in figures:
        measured = f"not measured: {figure.reason}" if figure.measured is None else figure.measured
        found.add_row(
            escape(figure.name),
            escape(figure.goal),
            escape(measured),
            REACHED[figure.reached],
            style=STYLE[figure.reached],
        )
    return found
