"""The error of a rejected bag."""

from __future__ import annotations

from phd_jdtc_ros.quoting import short


class BagError(Exception):
    """The bag cannot be used; the message is one line of bounded length with bag and reason.

    `corrupt` says whether the file is damaged, rather than missing or of another kind.
    """

    def __init__(self, message: str, corrupt: bool = False) -> None:
        super().__init__(short(message))
        self.corrupt = corrupt
