"""How errors quote what they were given, which may be of any length."""

from __future__ import annotations

import re

# Longer than any path that people write; and enough for every name of a large configuration.
LONGEST_WORD = 240
LONGEST = 4000
# How much is left of a word at each end.
_END = 60

_LONG_WORD = re.compile(rf"\S{{{LONGEST_WORD + 1},}}")


def short(text: str, longest: int = LONGEST) -> str:
    """Return a text without the middle of words that are too long, and then of the whole."""
    words = _LONG_WORD.sub(lambda word: _ends(word[0], _END), text)
    return words if len(words) <= longest else _ends(words, longest // 2)


def _ends(text: str, length: int) -> str:
    return f"{text[:length]} ... {text[-length:]}"
