"""The learned values of the sensors, as a table on the report's page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from ..learned import LearnedValue
from . import score_words


def section(learned: Sequence[LearnedValue], changes: Mapping[str, str]) -> str:
    """Return the table of configured and learned values; empty if nothing is learned.

    `changes` says how each sensor has changed, by name.
    """
    if not learned:
        return ""
    rows = [
        [
            value.sensor,
            value.quantity,
            *(
                f"{each:.3g} {value.unit}".rstrip()
                for each in (value.given, value.found, value.std)
            ),
        ]
        for value in learned
    ]
    headings = ("sensor", "parameter", "set", "found", "deviation")
    changed = "".join(
        f"<p><strong>{escape(name)}</strong>: {escape(text)}.</p>" for name, text in changes.items()
    )
    return (
        f"<h2>Sensors</h2>\n{score_words.narrow(headings, rows)}<p>What the tracker had learned of "
        "its sensors by the end of the run, and the standard deviation of what it found. The "
        f"detection probabilities are means over the targets.</p>{changed}"
    )
