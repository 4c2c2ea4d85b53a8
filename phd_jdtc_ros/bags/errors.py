"""The error that says why a bag was refused."""

from __future__ import annotations

from phd_jdtc_ros.quoting import short


class BagError(Exception):
    """A bag that cannot be used; the message is one line that says which and why.

    It is cut to a bounded length, because it may quote names that are in the bag.

    Attributes
    ----------
    corrupt : bool
        Whether the file is damaged, rather than missing or of another kind.
    """

    def __init__(self, message: str, corrupt: bool = False) -> None:
        super().__init__(short(message))
        self.corrupt = corrupt
