"""A hook of mkdocs: equations in LaTeX become MathML, which browsers draw without scripts or fonts.

pymdownx.arithmatex marks ``$...$`` and ``$$...$$`` in a page; here the marked text is converted.
"""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert

MARKED = re.compile(r'<(div|span) class="arithmatex">(.*?)</\1>', re.DOTALL)


def on_page_content(page_html: str, **_: Any) -> str:
    """Return a page with its equations converted."""
    return MARKED.sub(_equation, page_html)


def _equation(found: re.Match[str]) -> str:
    tag, marked = found.groups()
    # Between \( and \), or \[ and \].
    latex = html.unescape(marked).strip()[2:-2].strip()
    display = "block" if tag == "div" else "inline"
    return f'<{tag} class="equation">{convert(latex, display=display)}</{tag}>'
