"""Messages, clouds and their bytes; the error of a rejected message, and how it quotes it."""

from __future__ import annotations

import reprlib

from phd_jdtc_ros.quoting import short

# Quotations are shortened, because they enter log lines and a message may have a megabyte of text.
_QUOTED = reprlib.Repr()
_QUOTED.maxstring = 100
_QUOTED.maxlist = 20


def quote(value: str | list[str]) -> str:
    """Return the `repr` of a message's content, with the middle of a long text left out."""
    return _QUOTED.repr(value)


class RejectedMessageError(ValueError):
    """The message violates the contract and is rejected as a whole.

    `reason` is the key of the diagnostics' count: ``schema``, ``frame``, ``oversize``,
    ``not_finite`` or ``range``. `detail` states the fault, its place, and the allowed values.
    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(short(detail))
        self.reason = reason
