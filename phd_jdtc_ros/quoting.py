"""Shortens the quotations in errors: input may be of any length."""

from __future__ import annotations

import re

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


def _ends(text: str, length: int) -> str:
    return f"{text[:length]} ... {text[-length:]}"
