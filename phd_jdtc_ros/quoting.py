"""Texts in messages: quotations of input of any length, and lists of counts."""

from __future__ import annotations

import re
from collections.abc import Mapping

# Largest numbers of characters, of a word and in total: any path that people write is shorter, and
# so are all names of a large configuration.
LONGEST_WORD = 240
LONGEST = 4000
# Number of characters that are left at each end of a word.
_END = 60

_LONG_WORD = re.compile(rf"\S{{{LONGEST_WORD + 1},}}")


def short(text: str, longest: int = LONGEST) -> str:
    """Return a text without the middle of words that are too long, and then of the whole."""
    words = _LONG_WORD.sub(lambda word: _ends(word[0], _END), text)
    return words if len(words) <= longest else _ends(words, longest // 2)


def counts_text(counts: Mapping[str, int]) -> str:
    """Return the reasons with a count above 0, in alphabetical order, each with its count."""
    return ", ".join(f"{reason} {count}" for reason, count in sorted(counts.items()) if count)


def _ends(text: str, length: int) -> str:
    return f"{text[:length]} ... {text[-length:]}"
