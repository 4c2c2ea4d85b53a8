"""Texts in messages: quotations of input of any length and content, and lists of counts."""

from __future__ import annotations

import re
from collections.abc import Mapping

# Largest numbers of characters, of a word and in total: any path that people write is shorter, and
# so are all names of a large configuration.
LONGEST_WORD = 240
LONGEST = 4000

# Control characters but the line feed and the tab, and those that turn the direction of a text: a
# terminal would obey them.
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
_FORMS = re.compile(r"\[(?:([^][|]*)\|)?([^][|]*)\]")
_LONG_WORD = re.compile(rf"\S{{{LONGEST_WORD + 1},}}")


def short(text: str, longest: int = LONGEST) -> str:
    """Return a `printable` text without the middle of words that are too long, and of the whole."""
    # Number of characters that are left at each end of a word.
    words = _LONG_WORD.sub(lambda word: _ends(word[0], 60), text)
    return printable(words if len(words) <= longest else _ends(words, longest // 2))


def printable(text: str) -> str:
    """Return a text with escapes in the place of control characters, as Python writes them."""
    return _CONTROL.sub(lambda found: ascii(found[0])[1:-1], text)


def counts_text(counts: Mapping[str, int]) -> str:
    """Return the reasons with a count above 0, in alphabetical order, each with its count."""
    return ", ".join(f"{reason} {count}" for reason, count in sorted(counts.items()) if count)


def counted(number: int, text: str) -> str:
    """Return a number and what is counted; see `agreeing`."""
    return f"{number} {agreeing(number, text)}"


def agreeing(number: int, text: str) -> str:
    """Return a text in the singular or the plural, whose forms are in brackets.

    These are ``[of one|of several]``, or ``[of several]`` alone: ``cloud[s] that [ends|end]``.
    """
    return _FORMS.sub(lambda form: (form[1] or "") if number == 1 else form[2], text)


def _ends(text: str, length: int) -> str:
    return f"{text[:length]} ... {text[-length:]}"
