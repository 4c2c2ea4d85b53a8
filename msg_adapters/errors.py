"""The error that says why a message was refused, and how it quotes the message."""

from __future__ import annotations

import reprlib

from phd_jdtc_ros.quoting import short

# Log lines are made of what is quoted, and anybody on the network can send a megabyte of text.
_QUOTED = reprlib.Repr()
_QUOTED.maxstring = 100
_QUOTED.maxlist = 20


def quoted(value: str | list[str]) -> str:
    """Return the `repr` of what a message contains; the middle of a long text is left out."""
    return _QUOTED.repr(value)


class RejectedMessageError(ValueError):
    """A message that does not fit the contract; it is refused as a whole.

    Parameters
    ----------
    reason : str
        Key that diagnostics count by: ``schema``, ``frame``, ``oversize``, ``not_finite`` or
        ``range``.
    detail : str
        What is wrong, where, and what is allowed.
    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(short(detail))
        self.reason = reason
