# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
